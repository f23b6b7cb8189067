/**
 * Tells screen readers what the task says next, without a stream of words: at most one sentence in
 * a while, and of several that came meanwhile only the last. Pure.
 */

const PAUSE = 4; // s between two sentences
const TIMES = [120, 60, 30, 10]; // s left that are worth a word

export class AnnouncerQueue {
  constructor() {
    this.wanted = "";
    this.said = "";
    this.saidAt = -Infinity;
  }

  /**
   * @param {string} text what is true now
   * @param {number} now Unix seconds
   * @returns {string | null} what to say now, null for nothing new
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
 * The time that is left, in few enough steps to be read out.
 * @param {number | null} left seconds
 * @returns {number | null}
 */
export const roundLeft = (left) =>
  left === null ? null : (TIMES.findLast((step) => left <= step) ?? null);
