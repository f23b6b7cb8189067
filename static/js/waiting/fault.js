/** Whose fault it is that there is no video. */

import { standstillOf } from "../view/hud/standstill.js";

/**
 * Whether it is the robot that keeps the video away: it is gone or silent, has a fault, or its
 * camera gives none. Then nothing is to be looked for in the visitor's network. Pure.
 * @param {import("../drive/features.js").State} state
 */
export const isRobotsFault = ({ visit, robot, faults }) =>
  !visit.online ||
  Boolean(robot?.cameraStatus) ||
  ["fault", "not_connected"].includes(standstillOf(robot)) ||
  faults.some((/** @type {{part: string}} */ { part }) => part === "robot");
