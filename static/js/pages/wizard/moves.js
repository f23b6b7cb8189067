/**
 * The steps of a script that the page drives itself: a velocity for some seconds, or a turn by an
 * angle. Pure: times are seconds, angles radians, counter-clockwise positive; `heading` is where
 * the robot says that it looks.
 */

const SHARE = 0.6; // of the robot's largest turning speed
const SLOWEST = 0.25; // rad/s
const SETTLES = 0.06; // rad that a robot turns on after the last velocity
const MOST_TURN_SECONDS = 25;
const FULL = 2 * Math.PI;

/** The angle between -pi and pi. @param {number} angle */
export const wrapped = (angle) => angle - FULL * Math.round(angle / FULL);

/**
 * @typedef {object} Move
 * @property {number} since
 * @property {{linear: number, angular: number, seconds: number} | null} drive
 * @property {number} left radians that are still to turn
 * @property {number | null} heading as it was last
 */

/** @param {{drive: any, turn: number | null}} step @param {number} now @returns {Move} */
export const begin = ({ drive, turn }, now) => ({
  since: now,
  drive,
  left: turn ?? 0,
  heading: null,
});

/** Take where the robot looks now. @param {Move} move @param {number} heading @returns {Move} */
export const turned = (move, heading) => ({
  ...move,
  heading,
  left:
    move.drive || move.heading === null ? move.left : move.left - wrapped(heading - move.heading),
});

/**
 * The velocity of this moment, null when the move is over.
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
