/**
 * Full speeds (the lower of the robot's and the lease's limits, times the chosen step), and the
 * share of them for a held key: it starts low and rises, so that a short press is a small move.
 * Pure.
 */

export const STEPS = [0.4, 0.7, 1];
const CAUTIOUS = { linear: 0.4, reverse: 0.2, angular: 0.6 };

/**
 * @param {{linear: number, reverse: number, angular: number} | null} robot the factsheet's limits,
 *   null while unknown
 * @param {{linear: number | null, angular: number | null}} lease
 * @param {number} step index into STEPS
 * @returns {{linear: number, reverse: number, angular: number}} m/s, m/s, rad/s
 */
export const fullSpeeds = (robot, lease, step) => {
  const own = robot ?? CAUTIOUS;
  const share = STEPS[step];
  return {
    linear: share * Math.min(own.linear, lease.linear ?? Infinity),
    reverse: share * Math.min(own.reverse, lease.linear ?? Infinity),
    // Turning fast enough matters at every step, so its speed shrinks less than the speed ahead.
    angular: Math.sqrt(share) * Math.min(own.angular, lease.angular ?? Infinity),
  };
};

/**
 * @param {{ahead: number, left: number}} shares -1 to 1
 * @param {{linear: number, reverse: number, angular: number}} full
 * @returns {{linear: number, angular: number}}
 */
export const toVelocity = ({ ahead, left }, full) => ({
  linear: round(ahead * (ahead >= 0 ? full.linear : full.reverse)),
  angular: round(left * full.angular),
});

/** Tenths of a millimetre a second; and no -0, which JSON would show. @param {number} value */
const round = (value) => Math.round(value * 1e4) / 1e4 + 0;

export const START = 0.35;
const RISE = 0.9; // shares of full speed a second

/**
 * @param {number} current share of full speed, -1 to 1
 * @param {number} direction -1, 0 or 1, of the keys
 * @param {number} dt seconds
 * @returns {number} the next share; a release or a reversal takes effect at once
 */
export const ramp = (current, direction, dt) => {
  if (direction === 0) {
    return 0;
  }
  const held = Math.sign(current) === direction ? Math.abs(current) : 0;
  return direction * Math.min(1, Math.max(START, held + (held ? RISE * dt : 0)));
};
