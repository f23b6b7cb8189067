/**
 * The robot's head by a slider and by keys: what angle to ask for, and when. Pure but for the clock
 * that it is given.
 */

export const STEP = 0.1; // rad a press of a key
const PAUSE = 0.15; // s between two actions while the slider is drawn

export class Tilting {
  constructor() {
    /** @type {number | null} what the visitor wants and the robot has not been asked for */
    this.wanted = null;
    /** @type {number | null} what it was asked for last */
    this.asked = null;
    this.askedAt = -Infinity;
  }

  /** @param {number} angle rad @param {{minimum: number, maximum: number}} range */
  want(angle, { minimum, maximum }) {
    this.wanted = Math.min(maximum, Math.max(minimum, Math.round(angle * 1000) / 1000));
    return this.wanted;
  }

  /** The angle to ask for now, null for none. @param {number} now */
  take(now) {
    if (this.wanted === null || now - this.askedAt < PAUSE) {
      return null;
    }
    const angle = this.wanted;
    this.wanted = null;
    if (angle === this.asked && now - this.askedAt < 1) {
      return null;
    }
    this.asked = angle;
    this.askedAt = now;
    return angle;
  }

  /**
   * What the slider shows: the visitor's hand goes before what the robot reports.
   * @param {number | null} measured
   * @param {number} now
   */
  shown(measured, now) {
    return this.wanted ?? (this.asked !== null && now - this.askedAt < 2 ? this.asked : measured);
  }
}
