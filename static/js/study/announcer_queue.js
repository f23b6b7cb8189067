/**
 * Announces the task to screen readers: at most one sentence every few seconds, and of several only
 * the last. Pure.
 */

const PAUSE = 4; // s between two sentences
const TIMES = [120, 60, 30, 10]; // s left that are announced

export class AnnouncerQueue {
  constructor() {
    this.wanted = "";
    this.said = "";
    this.saidAt = -Infinity;
  }

  /**
   * @param {string} text the present sentence @param {number} now Unix seconds
   * @returns {string | null} the sentence to announce now, null for none
   */
  hear(text, now) {
    this.wanted = text;
    if (text === this.said || now - this.saidAt < PAUSE) {
      return null;
    }
    this.said = text;
    this.saidAt = now;
    return text;
  }
}

/**
 * The time left, in a few steps.
 * @param {number | null} left seconds
 * @returns {number | null}
 */
export const roundLeft = (left) =>
  left === null ? null : (TIMES.findLast((step) => left <= step) ?? null);
