/**
 * When the picture on the screen was taken, by the robot's clock. Chromium tells each shown frame's
 * RTP timestamp, the robot's `media` message tells which moment one RTP timestamp was. Pure.
 */

const MOST_SECONDS = 30; // a frame further than this from the told moment belongs to another stream

/**
 * @param {number} rtp of the frame, unsigned 32 bit
 * @param {{rtp: number, stamp: number, rate: number}} clock
 * @returns {number | null} Unix seconds by the robot's clock, null when the two cannot belong
 *   together
 */
export const captureStamp = (rtp, clock) => {
  // The difference of two counters that wrap, as a signed number of 32 bits.
  const ticks = (rtp - clock.rtp) | 0;
  const seconds = ticks / clock.rate;
  return Math.abs(seconds) <= MOST_SECONDS ? clock.stamp + seconds : null;
};

/** Keeps the stamp of the frame that is on the screen. A new stream has a new origin: `reset`. */
export class ShownFrame {
  /** @type {{rtp: number, stamp: number, rate: number} | null} */
  clock = null;
  /** @type {number | null} */
  rtp = null;
  at = -Infinity; // when it came onto the screen, Unix seconds of the page

  reset() {
    Object.assign(this, new ShownFrame());
  }

  /** @param {{rtp: number, stamp: number, rate: number}} clock from the robot */
  told(clock) {
    this.clock = clock;
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
