/**
 * Pictures through the server, for as long as no direct way to the robot is found. The page asks
 * for each one, and for the next when it is on the screen: whatever the network takes, one is on
 * its way and none waits. Times are Unix seconds of the page.
 */

const PATIENCE_SECONDS = 1.5; // until a picture that did not come is asked for again
const MOST_PATIENCE_SECONDS = 6;
// a picture that is older than the one on the screen by more is of a robot whose clock was set back
const STRAY_SECONDS = 20;
const FRESH_SECONDS = 2; // a picture that has been on the screen for longer is not of the present

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
  round = {}; // what is being drawn for an earlier round is not shown

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
   * Ask for the next picture if it is time; call often.
   * @param {number} now
   * @param {{roundTrip: number | null, visible: boolean}} page how long a small message takes, and
   *   whether anybody looks
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
      // it was given up for lost, and took the place of the one that was asked for instead
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

  /**
   * The way to the robot is back: what was asked for is lost, and asked for again at the next tick.
   */
  hurry() {
    this.askedAt = -Infinity;
    this.patience = PATIENCE_SECONDS;
  }

  /** Whether the picture on the screen is of the present. @param {number} now */
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
    this.stamp = null;
    this.shownAt = -Infinity;
    this.askedAt = -Infinity;
    this.patience = PATIENCE_SECONDS;
    this.roundTrip = null;
    this.drawing = false;
    this.frames = 0;
    this.bytes = 0;
    this.round = {};
  }
}
