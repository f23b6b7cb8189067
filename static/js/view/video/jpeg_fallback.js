/**
 * Frames through the server, while there is no direct connection. The page requests one, and the
 * next when it is shown, so that at any bandwidth one frame is in transit and none waits. Times are
 * Unix seconds of the page.
 */

const PATIENCE_SECONDS = 1.5; // until a frame is requested again
const MOST_PATIENCE_SECONDS = 6;
const STRAY_SECONDS = 20; // a frame older by more is of a robot whose clock was set back
const FRESH_SECONDS = 2; // a frame that was shown for longer is outdated

export class JpegFallback {
  on = false;
  /** @type {number | null} capture stamp of the frame on the screen, by the robot's clock */
  stamp = null;
  shownAt = -Infinity;
  askedAt = -Infinity;
  patience = PATIENCE_SECONDS;
  /** @type {number | null} */
  roundTrip = null;
  drawing = false;
  frames = 0;
  bytes = 0;
  round = {}; // a frame that is decoded for an earlier round is not shown

  /**
   * @param {object} options
   * @param {(request: {stamp: number, seen?: number, roundTrip?: number}) => boolean} options.ask
   *   whether it could be sent
   * @param {(jpeg: Uint8Array, isWanted: () => boolean) => Promise<boolean>} options.show
   * @param {() => void} options.onShown
   */
  constructor({ ask, show, onShown }) {
    this.ask = ask;
    this.show = show;
    this.onShown = onShown;
  }

  start() {
    this.on = true;
  }

  stop() {
    this.on = false;
    this.#forget();
  }

  /**
   * Requests the next frame if it is time; call it often.
   * @param {number} now
   * @param {{roundTrip: number | null, visible: boolean}} page the round trip of a small message
   */
  tick(now, { roundTrip, visible }) {
    this.roundTrip = roundTrip;
    if (!this.on || this.drawing || !visible || now - this.askedAt < this.patience) {
      return;
    }
    if (this.askedAt > -Infinity) {
      this.patience = Math.min(MOST_PATIENCE_SECONDS, 2 * this.patience);
    }
    this.#ask(now);
  }

  /** @param {{stamp: number, jpeg: Uint8Array}} picture @param {() => number} clock */
  async received({ stamp, jpeg }, clock) {
    if (!this.on || this.drawing) {
      return;
    }
    if (this.stamp !== null && stamp <= this.stamp && this.stamp - stamp < STRAY_SECONDS) {
      // it was late, and came instead of the one that was requested after it
      this.#ask(clock());
      return;
    }
    this.drawing = true;
    const { round } = this;
    const shown = await this.show(jpeg, () => this.on && round === this.round);
    if (round !== this.round) {
      return;
    }
    this.drawing = false;
    if (shown) {
      this.stamp = stamp;
      this.shownAt = clock();
      this.frames += 1;
      this.bytes += jpeg.length;
      this.patience = PATIENCE_SECONDS;
      this.#ask(clock());
      this.onShown();
    }
  }

  /** The robot is connected again: requests a frame at the next tick. */
  hurry() {
    this.askedAt = -Infinity;
    this.patience = PATIENCE_SECONDS;
  }

  /** Whether the frame on the screen is recent. @param {number} now */
  isFresh(now) {
    return this.on && now - this.shownAt < FRESH_SECONDS;
  }

  /** @param {number} now */
  #ask(now) {
    const sent = this.ask({
      stamp: now,
      seen: this.stamp ?? undefined,
      roundTrip: this.roundTrip ?? undefined,
    });
    this.askedAt = sent ? now : -Infinity;
  }

  #forget() {
    this.hurry();
    Object.assign(this, { stamp: null, shownAt: -Infinity, roundTrip: null, drawing: false });
    Object.assign(this, { frames: 0, bytes: 0, round: {} });
  }
}
