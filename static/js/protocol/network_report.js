/**
 * How the network did in the last second: for the page's own figures, and for the record of the session.
 */

import { encodePacket } from "./robot_api.js";
import { between, pick } from "./link_stats.js";

/**
 * @param {object} page
 * @param {ReturnType<typeof import("../drive/store.js").createStore>} page.store
 * @param {import("./socket.js").Socket} page.socket
 * @param {import("./link.js").Link} page.link
 * @param {import("../view/video/jpeg_fallback.js").JpegFallback} page.slow
 * @param {(now: number) => number | null} page.frameAge s
 */
export const createNetworkReport = ({ store, socket, link, slow, frameAge }) => {
  /** @type {import("./link_stats.js").Sample | null} */
  let before = null;

  /** @param {number} now @param {Partial<NonNullable<ReturnType<typeof between>>>} second */
  const tell = (now, second) => {
    store.update({ network: second });
    const { visit, way, roundTrip } = store.get();
    if (visit.phase === "driving") {
      const age = frameAge(now);
      const message = { stamp: now, way, roundTrip: roundTrip ?? undefined, frameAge: age ?? undefined, ...second };
      socket.send(encodePacket("page/network", message), { droppable: true });
    }
  };

  /** A second of pictures through the server, in the same words. @param {number} now */
  const tellSlow = (now) => {
    const second = { fps: slow.frames, bitrate: slow.bytes * 8, path: "server/jpeg" };
    slow.frames = 0;
    slow.bytes = 0;
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
      if (slow.on) {
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
