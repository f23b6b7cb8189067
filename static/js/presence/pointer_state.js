/**
 * Pointing on a video that is shown in two places: the spot of a pointer, when to send it, and how
 * long the other side's dot is shown. Pure, and the same on both sides. A spot is in shares of the
 * video's width from its left and of its height from its top, at any size of the video.
 */

import { boxOf } from "../view/overlay/camera_model.js";

export const EVERY = 1 / 15; // s between two messages; the robot takes twenty a second
const AGAIN = 0.8; // s after which a pressed pointer at rest is sent again, before its dot fades
export const STAYS = 2; // s that a dot is shown without another message
const LEAST = 0.8; // s that a dot is shown at least, for a tap to be seen

/** @typedef {Point} Spot */
/** @typedef {{left: number, top: number, width: number, height: number}} Frame CSS pixels */

/**
 * The frame of a picture in an element that shows it by `object-fit`, without the bars beside it.
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
 * The spot of a pointer, or the nearest one outside of the picture.
 * @param {Frame} frame @param {{clientX: number, clientY: number}} pointer @returns {Spot}
 */
export const spotIn = ({ left, top, width, height }, { clientX, clientY }) => [
  share((clientX - left) / width),
  share((clientY - top) / height),
];

/** The messages of our own pointer. */
export class Hand {
  constructor() {
    /** @type {Spot | null} */
    this.spot = null;
    this.pressed = false;
    /** @type {Spot | null} the last one that was sent */
    this.said = null;
    this.saidAt = -Infinity;
  }

  /** @param {Spot | null} spot null when it has left @param {boolean} [pressed] */
  is(spot, pressed = false) {
    this.spot = spot;
    this.pressed = pressed;
  }

  /**
   * What to send now: a spot, null when it has left, undefined for nothing.
   * @param {number} now s
   * @returns {Spot | null | undefined}
   */
  take(now) {
    const { spot, said } = this;
    const isNews = spot?.[0] !== said?.[0] || spot?.[1] !== said?.[1];
    const pause = spot === null ? 0 : !isNews ? AGAIN : said === null ? 2 * EVERY : EVERY;
    if ((!isNews && !this.pressed) || now - this.saidAt < pause) {
      return undefined;
    }
    this.said = spot;
    this.saidAt = now;
    return spot;
  }
}

/** The dot of one side; its messages arrive in any order, by one transport or two. */
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
  receive({ stamp, at }, now) {
    if (stamp < this.stamp && now - this.heardAt < STAYS) {
      return; // overtaken; after a silence, the sender's clock may have been set
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

  /** The dot to show. @param {number} now s @returns {Spot | null} */
  at(now) {
    return now < this.until ? this.spot : null;
  }
}
