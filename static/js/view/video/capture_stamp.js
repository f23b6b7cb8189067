/**
 * The capture time of the frame on the screen, by the robot's clock. Chromium reports the RTP
 * timestamp of each shown frame, the robot's `media` message has the time of one. Pure.
 */

const MOST_SECONDS = 30; // a frame further away from the time of `media` is of another stream

/**
 * @param {number} rtp of the frame, unsigned 32 bit
 * @param {{rtp: number, stamp: number, rate: number}} clock
 * @returns {number | null} Unix seconds by the robot's clock, null for another stream
 */
export const captureStamp = (rtp, clock) => {
  // The difference of two counters that wrap, as a signed number of 32 bits.
  const ticks = (rtp - clock.rtp) | 0;
  const seconds = ticks / clock.rate;
  return Math.abs(seconds) <= MOST_SECONDS ? clock.stamp + seconds : null;
};

/** The frame on the screen. Call `reset` for a new stream, which has a new origin. */
export class ShownFrame {
  /** @type {{rtp: number, stamp: number, rate: number} | null} the robot's `media` message */
  clock = null;
  /** @type {number | null} */
  rtp = null;
  at = -Infinity; // when it was shown, Unix seconds of the page

  reset() {
    Object.assign(this, new ShownFrame());
  }

  /** @param {number} rtp of the frame now shown @param {number} now Unix seconds */
  shown(rtp, now) {
    this.rtp = rtp >>> 0;
    this.at = now;
  }

  /** Capture stamp of the frame on the screen, by the robot's clock; null while unknown. */
  get stamp() {
    return this.clock && this.rtp !== null ? captureStamp(this.rtp, this.clock) : null;
  }
}
