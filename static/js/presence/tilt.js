/** The angle of the robot's head to request, by a slider and by keys, and when. Pure. */

export const STEP = 0.1; // rad a press of a key
const PAUSE = 0.15; // s between two actions while the slider is dragged
const PATIENCE = 4; // s that a head has to reach the requested angle
const ON_ITS_WAY = 0.5; // s in which a reported angle may be older than the request
const THERE = 0.02; // rad; the tolerance of an angle that is reached

export class Tilting {
  constructor() {
    /** @type {number | null} the angle to request */
    this.wanted = null;
    /** @type {number | null} the last request */
    this.asked = null;
    this.askedAt = -Infinity;
    /** @type {number | null} while the slider is pressed */
    this.held = null;
  }

  /** @param {number} angle rad @param {{minimum: number, maximum: number}} range */
  want(angle, { minimum, maximum }) {
    this.wanted = Math.min(maximum, Math.max(minimum, Math.round(angle * 1000) / 1000));
    this.held = this.held === null ? null : this.wanted;
    return this.wanted;
  }

  /** The angle to request now, null for none. @param {number} now */
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

  /** The slider is pressed and shows this. @param {number} angle rad */
  hold(angle) {
    this.held = angle;
  }

  letGo() {
    this.held = null;
  }

  /**
   * The angle of the slider: that of the visitor's hand; else the requested one, until the head has
   * reached it or had the time to; else the reported one.
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
