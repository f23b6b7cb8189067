/**
 * How the network did in the last second: for the page's own figures, and for the record of the
 * session.
 */

import { encodePacket } from "./robot_api.js";
import { between, pick } from "./link_stats.js";

/**
 * @param {object} page @param {Store} page.store @param {import("./socket.js").Socket} page.socket
 * @param {import("./link.js").Link} page.link
 * @param {() => {fallback: import("../view/video/jpeg_fallback.js").JpegFallback, frameAge: (now:
 *   number) => number | null}} page.video
 */
export const createNetworkReport = ({ store, socket, link, video }) => {
  /** @type {import("./link_stats.js").Sample | null} */
  let before = null;

  /** @param {number} now @param {Partial<NonNullable<ReturnType<typeof between>>>} second */
  const tell = (now, second) => {
    store.update({ network: second });
    const { visit, transport, roundTrip } = store.get();
    if (visit.phase === "driving") {
      const age = video().frameAge(now);
      const message = {
        stamp: now,
        way: transport,
        roundTrip: roundTrip ?? undefined,
        frameAge: age ?? undefined,
        ...second,
      };
      socket.send(encodePacket("page/network", message), { droppable: true });
    }
  };

  /** A second of pictures through the server, in the same words. @param {number} now */
  const tellSlow = (now) => {
    const { fallback } = video();
    const second = { fps: fallback.frames, bitrate: fallback.bytes * 8, path: "server/jpeg" };
    fallback.frames = 0;
    fallback.bytes = 0;
    tell(now, second);
  };

  return {
    /** A link that begins has nothing to be compared with. */
    begin: () => {
      before = null;
    },
    /** To be called once a second. @param {number} now Unix time */
    second: async (now) => {
      const { peer } = link;
      if (video().fallback.on) {
        tellSlow(now);
      } else if (peer) {
        const sample = pick((await peer.connection.getStats()).values());
        if (peer === link.peer) {
          const second = sample && before && between(before, sample);
          before = sample;
          if (second) {
            tell(now, second);
          }
        }
      }
    },
  };
};
