/** The time line: seconds and pixels, its ticks, and how a moment is written. Pure. */

const STEPS = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600]; // s between ticks
const TICK_WIDTH = 64; // CSS pixels that a tick and its words need
export const AXIS = 52; // CSS pixels on either side of the strips, for their axes

/** The width between the axes. @param {number} width of the strips, CSS pixels */
export const plotWidth = (width) => Math.max(0, width - 2 * AXIS);

/** @param {number} t @param {number} duration @returns {number} */
export const clamp = (t, duration) => Math.min(Math.max(Number.isFinite(t) ? t : 0, 0), duration);

/** @param {number} t s @param {number} duration s @param {number} width CSS pixels */
export const xOf = (t, duration, width) => (duration > 0 ? (t / duration) * width : 0);

/** @param {number} x CSS pixels @param {number} duration s @param {number} width CSS pixels */
export const timeAt = (x, duration, width) =>
  width > 0 ? clamp((x / width) * duration, duration) : 0;

/**
 * Times of ticks whose labels do not touch.
 * @param {number} duration s @param {number} width CSS pixels @returns {number[]}
 */
export const ticks = (duration, width) => {
  const least = (duration * TICK_WIDTH) / Math.max(width, 1);
  const step = STEPS.find((each) => each >= least) ?? Math.ceil(least / 3600) * 3600;
  return Array.from({ length: Math.floor(duration / step) + 1 }, (_, i) => i * step);
};

/** `2:05`, and `2:05.3` with tenths. @param {number} t s @param {boolean} [tenths] */
export const written = (t, tenths = false) => {
  const whole = tenths ? Math.floor(t * 10 + 1e-6) / 10 : Math.floor(t + 1e-6);
  const [minutes, seconds] = [Math.floor(whole / 60), whole % 60];
  const digits = tenths ? seconds.toFixed(1).padStart(4, "0") : String(seconds).padStart(2, "0");
  return `${minutes}:${digits}`;
};

/** The time of `?t=`. @param {string} search of an address @param {number} duration */
export const asked = (search, duration) =>
  clamp(parseFloat(new URLSearchParams(search).get("t") ?? "0"), duration);
