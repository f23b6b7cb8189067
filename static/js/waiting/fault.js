/** Whose fault it is that there is no video. */

import { isAway } from "../protocol/standstill.js";

/**
 * Whether it is the robot that keeps the video away: it is gone or silent, has a fault, or its
 * camera gives none. Then nothing is to be looked for in the visitor's network. Pure.
 * @param {State} state
 */
export const isRobotsFault = ({ visit, robot, faults }) =>
  !visit.online ||
  Boolean(robot?.cameraStatus) ||
  isAway(robot) ||
  robot?.safety.inhibited === "fault" ||
  faults.some((/** @type {{part: string}} */ { part }) => part === "robot");
