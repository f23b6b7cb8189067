/**
 * How fast "full speed" is: the least of robot and lease, times the step that the visitor chose. Pure.
 */

export const STEPS = [0.4, 0.7, 1];
const CAUTIOUS = { linear: 0.4, reverse: 0.2, angular: 0.6 };

/**
 * @param {{linear: number, reverse: number, angular: number} | null} robot the factsheet's limits, null while unknown
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
    // Turning slowly enough to aim matters at every step, so it shrinks less than the speed ahead.
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
