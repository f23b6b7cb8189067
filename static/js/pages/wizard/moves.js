/**
 * The steps of a script that the page drives itself: a velocity for some seconds, or a turn by an
 * angle. Pure: times are in seconds, angles in radians, counter-clockwise positive; `heading` is of
 * the robot's pose.
 */

import { wrap } from "../../lib/transforms.js";

const SHARE = 0.6; // of the robot's largest turning speed
const SLOWEST = 0.25; // rad/s
const SETTLES = 0.06; // rad that a robot turns after the last velocity
const MOST_TURN_SECONDS = 25;

/**
 * @typedef {object} Move
 * @property {number} since
 * @property {{linear: number, angular: number, seconds: number} | null} drive
 * @property {number} left radians to turn
 * @property {number | null} heading the last one
 */

/** @param {{drive: any, turn: number | null}} step @param {number} now @returns {Move} */
export const begin = ({ drive, turn }, now) => ({
  since: now,
  drive,
  left: turn ?? 0,
  heading: null,
});

/** Takes the robot's heading. @param {Move} move @param {number} heading @returns {Move} */
export const turned = (move, heading) => ({
  ...move,
  heading,
  left: move.drive || move.heading === null ? move.left : move.left - wrap(heading - move.heading),
});

/**
 * The velocity of now, null when the move has ended.
 * @param {Move} move @param {number} now @param {{angular: number}} limits
 * @returns {{linear: number, angular: number} | null}
 */
export const velocityOf = (move, now, limits) => {
  const seconds = now - move.since;
  if (move.drive) {
    const { linear, angular, seconds: length } = move.drive;
    return seconds < length ? { linear, angular } : null;
  }
  if (Math.abs(move.left) < SETTLES || seconds > MOST_TURN_SECONDS) {
    return null;
  }
  const speed = Math.max(SLOWEST, Math.min(SHARE * limits.angular, Math.abs(move.left)));
  return { linear: 0, angular: Math.sign(move.left) * speed };
};
