/** A session starts with a view of the room, and not of the wall behind the dock. Pure. */

import { roleOf } from "../protocol/session.js";
import { setsOut } from "./offer.js";

export const DOCKS_WITHIN = 5; // s for a robot at its contacts to report that it is docked
const AT_REST = 0.02; // m/s and rad/s

/** @param {{linear: number, angular: number}} velocity */
const isAtRest = ({ linear, angular }) => Math.max(Math.abs(linear), Math.abs(angular)) < AT_REST;

/**
 * Whether the robot leaves its dock now: yes, no, or null while that is unknown. Once in a session,
 * not after a reload of the page, and not when the robot was stopped since the session started.
 * @param {State} state @param {number} now @returns {boolean | null}
 */
export const leavesByItself = (state, now) => {
  const { visit, robot, factsheet, playing, arrival } = state;
  const isKnown = playing && robot && factsheet && (arrival?.session ?? null) === visit.session;
  if (roleOf(visit) !== "driver" || !isKnown) {
    return null;
  }
  const isOpen = arrival?.isOver === false;
  if (isOpen && now < arrival.since + DOCKS_WITHIN && !robot.docked && isAtRest(robot.velocity)) {
    return null;
  }
  const leaves =
    isOpen &&
    arrival.stopId === robot.safety.stopId &&
    !visit.returning &&
    !robot.safety.estop &&
    setsOut(state);
  // A robot refuses until it has its driver's lease and first heartbeats.
  return leaves && ["no_lease", "stopped"].includes(robot.safety.inhibited) ? null : leaves;
};
