/** The alert of the operator's page about a fault. Pure. */

import { faultAlert } from "../../protocol/faults.js";

/**
 * @param {object} page @param {unknown} page.granted null while it does not operate the robot
 * @param {boolean} page.connected @param {boolean} page.silent whether an open WebSocket is silent
 * @param {import("../../protocol/faults.js").ShownFault[]} page.faults
 * @param {number} now Unix time
 */
export const faultFor = ({ granted, connected, silent, faults }, now) =>
  faultAlert({
    visit: {
      phase: granted ? "driving" : "watching",
      // the operator's commands take the broker only, not the link of the video
      link: "lost",
      socket: connected ? "open" : "lost",
    },
    faults,
    serverSilent: silent,
    now,
  });
