/**
 * The pause before attempt n: doubled each time, bounded, and random, so that a thousand pages do
 * not reconnect at the same moment.
 * @param {number} attempt 0 is the first
 * @param {{first?: number, most?: number, random?: () => number}} [options] times in seconds
 * @returns {number} seconds
 */
export const backoff = (attempt, { first = 0.25, most = 5, random = Math.random } = {}) => {
  const whole = Math.min(most, first * 2 ** Math.min(attempt, 16));
  return whole * (0.5 + 0.5 * random());
};
