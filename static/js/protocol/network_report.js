/** The network in the last second: for the page's figures, and for the record of the session. */

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
  const report = (now, second) => {
    store.update({ network: second });
    const { visit, transport: way, roundTrip } = store.get();
    if (visit.phase === "driving") {
      const [trip, age] = [roundTrip ?? undefined, video().frameAge(now) ?? undefined];
      const message = { stamp: now, way, roundTrip: trip, frameAge: age, ...second };
      socket.send(encodePacket("page/network", message), { droppable: true });
    }
  };

  return {
    /** A new link starts. */
    begin: () => {
      before = null;
    },
    /** Call it once a second. @param {number} now Unix time */
    second: async (now) => {
      const { peer } = link;
      const { fallback } = video();
      if (fallback.on) {
        const { frames, bytes } = fallback;
        Object.assign(fallback, { frames: 0, bytes: 0 });
        report(now, { fps: frames, bitrate: bytes * 8, path: "server/jpeg" });
      } else if (peer) {
        const sample = pick((await peer.connection.getStats()).values());
        if (peer === link.peer) {
          const second = sample && before && between(before, sample);
          before = sample;
          if (second) {
            report(now, second);
          }
        }
      }
    },
  };
};
