import { isAway } from "../protocol/standstill.js";

/**
 * Whether the robot is why there is no video: it is offline or silent, has a fault, or its camera
 * sends none. The visitor's network is then not checked. Pure.
 * @param {State} state
 */
export const isRobotsFault = ({ visit, robot, faults }) =>
  !visit.online ||
  Boolean(robot?.cameraStatus) ||
  isAway(robot) ||
  robot?.safety.inhibited === "fault" ||
  faults.some(({ part }) => part === "robot");
