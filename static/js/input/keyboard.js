/** Steering with keys. key_dispatcher.js decides which keys count, and when all are released. */

import { ramp } from "./speeds.js";

const DIRECTIONS = /** @type {Record<string, [string, number]>} */ ({
  forward: ["ahead", 1],
  backward: ["ahead", -1],
  left: ["left", 1],
  right: ["left", -1],
});
const STEPS = /** @type {Record<string, number>} */ ({ faster: 1, slower: -1 });
const LONGEST_FRAME = 0.1; // s; a page that was held up must not jump to full speed

export class Keyboard {
  /**
   * @param {object} options @param {KeyDispatcher} options.keys
   * @param {(shares: {ahead: number, left: number}) => void} options.emit -1 to 1 each
   * @param {() => void} options.stop brake: its key, and every disable
   * @param {(change: number) => void} options.step a speed step up or down
   * @param {() => void} [options.barred] a key was pressed that may not steer
   * @param {(callback: (ms: number) => void) => unknown} [options.frame]
   * @param {() => number} [options.now] ms
   */
  constructor({
    keys,
    emit,
    stop,
    step,
    barred = () => undefined,
    frame = (callback) => requestAnimationFrame(callback),
    now = () => performance.now(),
  }) {
    this.keys = keys;
    this.emit = emit;
    this.stop = stop;
    this.step = step;
    this.barred = barred;
    /** Where keys may not steer, they still stop the robot. */
    this.steers = true;
    this.frame = frame;
    this.now = now;
    /** @type {Map<string, string>} the command of each key that is down */
    this.held = new Map();
    this.shares = { ahead: 0, left: 0 };
    this.at = 0;
    this.enabled = false;
    this.methods = ["keyboard"];
    this.running = false;
  }

  enable() {
    if (!this.enabled) {
      this.enabled = true;
      this.keys.add(this);
    }
  }

  disable() {
    if (this.enabled) {
      this.enabled = false;
      this.keys.remove(this);
      this.letGo();
      this.stop();
    }
  }

  /** All keys count as released, until they are pressed again. */
  letGo() {
    this.held.clear();
    this.#move(0);
  }

  /** @param {KeyboardEvent} event */
  down(event) {
    const command = this.keys.keymap.commandOf(event);
    if (command === "stop" && !event.repeat) {
      this.stop();
    }
    if (command === "stop" && !isButton(event.target)) {
      event.preventDefault();
    } else if (Object.hasOwn(STEPS, command)) {
      this.step(STEPS[command]);
    } else if (Object.hasOwn(DIRECTIONS, command)) {
      event.preventDefault();
      if (!this.steers) {
        this.barred();
        return;
      }
      // The browser's repetition must not press a key that the page has released.
      if (!event.repeat && !this.held.has(event.code)) {
        this.held.set(event.code, command);
        this.at = this.now();
        this.#move(0);
        this.#run();
      }
    }
  }

  /** @param {KeyboardEvent} event */
  up(event) {
    if (this.held.delete(event.code)) {
      this.#move(0);
    }
  }

  #run() {
    if (!this.running) {
      this.running = true;
      this.frame(() => this.#tick());
    }
  }

  #tick() {
    this.running = false;
    if (this.held.size === 0) {
      return;
    }
    const now = this.now();
    const dt = Math.min(LONGEST_FRAME, Math.max(0, (now - this.at) / 1000));
    this.at = now;
    this.#move(dt);
    this.#run();
  }

  /** @param {number} dt seconds since the last move */
  #move(dt) {
    const wish = direction(this.held.values());
    const next = {
      ahead: ramp(this.shares.ahead, wish.ahead, dt),
      left: ramp(this.shares.left, wish.left, dt),
    };
    if (next.ahead !== this.shares.ahead || next.left !== this.shares.left) {
      this.shares = next;
      this.emit(next);
    }
  }
}

/** The sum of the held keys: opposite ones cancel out. @param {Iterable<string>} held commands */
export const direction = (held) => {
  const sum = { ahead: 0, left: 0 };
  for (const command of held) {
    const [axis, sign] = DIRECTIONS[command] ?? [];
    if (axis === "ahead" || axis === "left") {
      sum[axis] += sign;
    }
  }
  return { ahead: Math.sign(sum.ahead), left: Math.sign(sum.left) };
};

/** @param {any} element */
const isButton = (element) => Boolean(element?.closest?.("button, a[href], summary"));
