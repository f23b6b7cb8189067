/** How a visit begins: with the room in sight, and not the wall behind the station. Pure. */

import { roleOf } from "../protocol/session.js";
import { setsOut } from "./offer.js";

/**
 * Whether the robot is to leave its station now, so that a visitor who has just arrived sees the
 * room and not the wall: yes, no, or null while that cannot be told. Once a visit, not for a
 * visitor who comes back to the same visit, and not when anybody has stopped it since it began.
 * @param {import("../drive/features.js").State} state
 * @returns {boolean | null}
 */
export const leavesByItself = (state) => {
  const { visit, robot, factsheet, playing, arrival } = state;
  const isKnown = playing && robot && factsheet && (arrival?.session ?? null) === visit.session;
  if (roleOf(visit) !== "driver" || !isKnown) {
    return null;
  }
  const leaves =
    arrival?.isOver === false &&
    arrival.stopId === robot.safety.stopId &&
    !visit.returning &&
    !robot.safety.estop &&
    setsOut(state);
  // A robot refuses until it has its driver's lease and first heartbeats.
  return leaves && ["no_lease", "stopped"].includes(robot.safety.inhibited) ? null : leaves;
};
