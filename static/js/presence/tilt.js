/**
 * The robot's head by a slider and by keys: what angle to ask for, and when. Pure but for the clock
 * that it is given.
 */

export const STEP = 0.1; // rad a press of a key
const PAUSE = 0.15; // s between two actions while the slider is drawn
const PATIENCE = 4; // s that a head has to get where it was asked to
const ON_ITS_WAY = 0.5; // s in which what it reports may be from before it was asked
const THERE = 0.02; // rad; nearer than that it is there

export class Tilting {
  constructor() {
    /** @type {number | null} what the visitor wants and the robot has not been asked for */
    this.wanted = null;
    /** @type {number | null} what it was asked for last */
    this.asked = null;
    this.askedAt = -Infinity;
    /** @type {number | null} where a hand holds the slider */
    this.held = null;
  }

  /** @param {number} angle rad @param {{minimum: number, maximum: number}} range */
  want(angle, { minimum, maximum }) {
    this.wanted = Math.min(maximum, Math.max(minimum, Math.round(angle * 1000) / 1000));
    this.held = this.held === null ? null : this.wanted;
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

  /** A hand is on the slider, which shows this. @param {number} angle rad */
  hold(angle) {
    this.held = angle;
  }

  letGo() {
    this.held = null;
  }

  /**
   * What the slider shows: the visitor's hand goes before what the robot reports, and so does what
   * the hand has asked for until the head is there, or has had the time for it.
   * @param {number | null} measured @param {number} now
   */
  shown(measured, now) {
    const own = this.held ?? this.wanted;
    if (own !== null || this.asked === null) {
      return own ?? measured;
    }
    const age = now - this.askedAt;
    const isThere = measured !== null && Math.abs(measured - this.asked) < THERE;
    return age > PATIENCE || (isThere && age > ON_ITS_WAY) ? measured : this.asked;
  }
}
