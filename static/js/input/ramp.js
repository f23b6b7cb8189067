/**
 * From a held key to a speed: a gentle start, then more, so that a short press is a small move. Pure.
 */

export const START = 0.35;
const RISE = 0.9; // shares of full speed a second

/**
 * @param {number} current share of full speed, -1 to 1
 * @param {number} direction -1, 0 or 1: what the keys say
 * @param {number} dt seconds
 * @returns {number} the next share; letting go and turning round take effect at once
 */
export const ramp = (current, direction, dt) => {
  if (direction === 0) {
    return 0;
  }
  const held = Math.sign(current) === direction ? Math.abs(current) : 0;
  return direction * Math.min(1, Math.max(START, held + (held ? RISE * dt : 0)));
};
