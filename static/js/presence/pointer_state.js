/**
 * Pointing on a picture that stands in two places: where a hand is on it, when to say so, and how
 * long a dot stays. Pure, and the same on both sides. A spot is in shares of the picture's width
 * from its left and of its height from its top, so that it is the same one however large the
 * picture is shown.
 */

import { boxOf } from "../view/overlay/camera_model.js";

// s between two pointers that are sent; the robot takes twenty a second
export const EVERY = 1 / 15;
// s after which a hand that is pressed and rests is told again, before its dot fades
const AGAIN = 0.8;
export const STAYS = 2; // s without another until a dot goes away
// s that a dot is shown at least: a finger that only taps is gone before anybody has looked
const LEAST = 0.8;

/** @typedef {Point} Spot */
/** @typedef {{left: number, top: number, width: number, height: number}} Frame CSS pixels */

/**
 * Where a picture lies in the element that shows it by `object-fit`, without the bars beside it.
 * @param {{width: number, height: number}} picture
 * @param {number} width CSS pixels of the element
 * @param {number} height @param {string} fit @returns {Frame}
 */
export const frameOf = (picture, width, height, fit) => {
  const { left, top, scale } = boxOf(picture, width, height, fit);
  return { left, top, width: scale * picture.width, height: scale * picture.height };
};

/** @param {number} value */
const share = (value) => Math.round(1e4 * Math.min(1, Math.max(0, value))) / 1e4;

/**
 * The spot of a hand, or the nearest one when it has left the picture.
 * @param {Frame} frame @param {{clientX: number, clientY: number}} hand in the same pixels
 * @returns {Spot}
 */
export const spotIn = ({ left, top, width, height }, { clientX, clientY }) => [
  share((clientX - left) / width),
  share((clientY - top) / height),
];

/** What there is to say of a hand, and when. */
export class Hand {
  constructor() {
    /** @type {Spot | null} */
    this.spot = null;
    this.pressed = false;
    /** @type {Spot | null} what was said last */
    this.said = null;
    this.saidAt = -Infinity;
  }

  /** @param {Spot | null} spot where it is, null when it is gone @param {boolean} [pressed] */
  is(spot, pressed = false) {
    this.spot = spot;
    this.pressed = pressed;
  }

  /**
   * What to say now: a spot, null that it is gone, undefined for nothing.
   * @param {number} now s
   * @returns {Spot | null | undefined}
   */
  take(now) {
    const { spot, said } = this;
    const isNews = spot?.[0] !== said?.[0] || spot?.[1] !== said?.[1];
    // that it is gone is told at once, and counts
    const pause = spot === null ? 0 : !isNews ? AGAIN : said === null ? 2 * EVERY : EVERY;
    if ((!isNews && !this.pressed) || now - this.saidAt < pause) {
      return undefined;
    }
    this.said = spot;
    this.saidAt = now;
    return spot;
  }
}

/** One side's dot, as it is told: in any order, by one way or two. */
export class RemotePointer {
  constructor() {
    /** @type {Spot | null} */
    this.spot = null;
    this.stamp = -Infinity;
    this.heardAt = -Infinity;
    this.lifted = true;
    this.since = -Infinity;
    this.until = -Infinity;
  }

  /**
   * @param {{stamp: number, at: Spot | null}} message by the sender's clock
   * @param {number} now by ours, s
   */
  told({ stamp, at }, now) {
    if (stamp < this.stamp && now - this.heardAt < STAYS) {
      return; // overtaken; after a while of silence the sender's clock may have been set
    }
    this.stamp = stamp;
    this.heardAt = now;
    if (at === null) {
      this.until = Math.min(this.until, Math.max(now, this.since + LEAST));
    } else {
      this.since = this.lifted || now >= this.until ? now : this.since;
      this.spot = at;
      this.until = now + STAYS;
    }
    this.lifted = at === null;
  }

  /** Where it is to be seen. @param {number} now s @returns {Spot | null} */
  at(now) {
    return now < this.until ? this.spot : null;
  }
}
