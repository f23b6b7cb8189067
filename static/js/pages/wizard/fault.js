/** What the operator's page says of a part that does not work. Pure. */

import { faultAlert } from "../../protocol/faults.js";

/**
 * @param {object} told
 * @param {unknown} told.granted null while this page does not operate the robot
 * @param {boolean} told.connected
 * @param {boolean} told.silent whether the WebSocket brings nothing any more
 * @param {import("../../protocol/faults.js").ShownFault[]} told.faults
 * @param {number} now Unix time
 */
export const faultFor = ({ granted, connected, silent, faults }, now) =>
  faultAlert({
    visit: {
      phase: granted ? "driving" : "watching",
      // The operator's commands go through the broker alone, whatever becomes of the video's link.
      link: "lost",
      socket: connected ? "open" : "lost",
    },
    faults,
    serverSilent: silent,
    now,
  });
