/**
 * The velocity for driving to a point of the floor, turning to one, and backing out of the dock.
 * Pure.
 *
 * One arc leads from a robot to each point ahead: its curvature is 2 y / (x² + y²), as in pure
 * pursuit (Coulter, Implementation of the Pure Pursuit Path Tracking Algorithm, 1992). The robot
 * first turns to a point that is far aside.
 */

import { robotFromMap, mapFromRobot } from "../lib/transforms.js";
import { arcSteps, sweep } from "../lib/swept_path.js";

const ARRIVED = 0.12; // m
export const SIDE_TURN = 0.6; // rad that a press at a side of the video turns
export const ABOUT = 3; // rad of "Turn around": less than half a turn, so that its side is certain
export const BACK_OUT = 0.55; // m backwards out of the dock: then there is room to turn
const TURN_FIRST_BEARING = 0.9; // rad; a point further aside is turned to on the spot
const SHARPEST = 2; // 1/m
const BACK_SPEED = 0.15; // m/s
const LEAST_DISTANCE = 0.3; // m; the robot does not drive less
const FARTHEST = 8; // m; beyond, the floor is a thin line under the horizon
const BEARING_TOLERANCE = 0.05; // rad
const LEAST_TURN = 0.15; // rad/s, which every robot can do
const STAND_OFF = 0.15; // m between the robot and an obstacle at the end of a path

/** @typedef {{linear: number, reverse: number, angular: number}} Full speeds, m/s and rad/s */

/**
 * @param {Place} robot
 * @param {Point} goal m, of the map
 * @param {Full} full
 * @param {number} braking m/s²
 * @returns {{linear: number, angular: number} | null} null when it is there
 */
export const towards = (robot, goal, full, braking) => {
  const [x, y] = robotFromMap(robot, goal);
  const [distance, bearing] = [Math.hypot(x, y), Math.atan2(y, x)];
  // A point that was just missed is not hunted for in circles.
  if (distance < ARRIVED || (distance < 3 * ARRIVED && Math.abs(bearing) > TURN_FIRST_BEARING)) {
    return null;
  }
  if (Math.abs(bearing) > TURN_FIRST_BEARING) {
    return { linear: 0, angular: Math.sign(bearing) * Math.min(full.angular, Math.abs(bearing)) };
  }
  const curvature = Math.max(-SHARPEST, Math.min(SHARPEST, (2 * y) / (distance * distance)));
  const linear = Math.min(
    full.linear,
    Math.sqrt(braking * distance),
    full.angular / Math.max(1e-6, Math.abs(curvature)),
  );
  return { linear, angular: linear * curvature };
};

/**
 * On the spot, to look at a point.
 * @param {Place} robot
 * @param {Point} point m, of the map
 * @param {Full} full
 * @returns {{linear: number, angular: number} | null} null when it looks there
 */
export const turnTo = (robot, point, full) => {
  const [x, y] = robotFromMap(robot, point);
  const bearing = Math.atan2(y, x);
  return Math.abs(bearing) < BEARING_TOLERANCE
    ? null
    : {
        linear: 0,
        angular:
          Math.sign(bearing) * Math.min(full.angular, Math.max(LEAST_TURN, Math.abs(bearing))),
      };
};

/**
 * A point to look at after a turn.
 * @param {Place} robot
 * @param {number} turn rad
 * @returns {Point} m, of the map
 */
export const lookingAt = (robot, turn) => mapFromRobot(robot, [Math.cos(turn), Math.sin(turn)]);

/**
 * The arc that `towards` takes.
 * @param {Place} robot @param {Point} goal @returns {import("../lib/swept_path.js").Step[]}
 */
export const arcTo = (robot, goal) => {
  const [x, y] = robotFromMap(robot, goal);
  const [distance, bearing] = [Math.hypot(x, y), Math.atan2(y, x)];
  const rest = Math.max(-TURN_FIRST_BEARING, Math.min(TURN_FIRST_BEARING, bearing));
  const length = Math.abs(rest) < 1e-3 ? distance : (distance * rest) / Math.sin(rest);
  return arcSteps(
    { ...robot, theta: robot.theta + bearing - rest },
    (2 * Math.sin(rest)) / (distance || 1),
    length,
  );
};

/**
 * @param {Place} robot
 * @param {Point} from where it stood
 * @param {Full} full
 * @returns {{linear: number, angular: number} | null} null when it is out
 */
export const backOut = (robot, from, full) =>
  Math.hypot(robot.x - from[0], robot.y - from[1]) >= BACK_OUT
    ? null
    : { linear: -Math.min(BACK_SPEED, full.reverse), angular: 0 };

/**
 * @typedef {{goal: Point, sweptPath: SweptPath, cut?: boolean}
 *   | {no: "sky" | "wall" | "close" | "here"}} Reach `cut`: the goal is before an obstacle
 */

/**
 * The goal of a press on the floor: that point, or the last one before an obstacle.
 * @param {Place} robot
 * @param {Point} point m, robot's frame
 * @param {Point[]} footprint
 * @param {Point[]} seen m, of the map
 * @returns {Reach}
 */
export const reach = (robot, point, footprint, seen) => {
  if (Math.hypot(...point) < 3 * ARRIVED) {
    return { no: "here" };
  }
  const share = Math.min(1, FARTHEST / Math.hypot(...point));
  const steps = arcTo(robot, mapFromRobot(robot, [share * point[0], share * point[1]]));
  const sweptPath = sweep(steps, footprint, seen);
  if (sweptPath?.blocked) {
    const free = cut(steps, sweptPath.length - STAND_OFF);
    const last = free.at(-1);
    return sweptPath.length - STAND_OFF < LEAST_DISTANCE || !last
      ? { no: "close" }
      : { goal: [last.x, last.y], sweptPath, cut: true };
  }
  return sweptPath?.slices.length
    ? { goal: [sweptPath.end.x, sweptPath.end.y], sweptPath }
    : { no: "close" };
};

/**
 * The first steps of a path.
 * @param {import("../lib/swept_path.js").Step[]} steps
 * @param {number} length m
 */
const cut = (steps, length) => {
  let distance = 0;
  return steps.filter((step, i) => {
    distance += i === 0 ? 0 : Math.hypot(step.x - steps[i - 1].x, step.y - steps[i - 1].y);
    return distance <= length;
  });
};
