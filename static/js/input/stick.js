/**
 * Steering with a finger: a stick on the screen. Which way it is pushed is where the robot goes,
 * how far is how fast.
 */

const DEAD = 0.14; // of the radius
const LEAST = 0.12; // the share of full speed at the edge of the dead zone
const SNAP = 0.12; // a direction this close to straight is straight

/**
 * @param {number} x right, in radii @param {number} y down, in radii
 * @returns {{ahead: number, left: number}} -1 to 1
 */
export const sharesOf = (x, y) => {
  const length = Math.hypot(x, y);
  if (!(length > DEAD)) {
    return { ahead: 0, left: 0 };
  }
  // Squared beyond the dead zone: fine near the middle, everything at the rim.
  const push = Math.min(1, (length - DEAD) / (1 - DEAD));
  const size = LEAST + (1 - LEAST) * push * push;
  const snapped = (/** @type {number} */ value) => (Math.abs(value) < SNAP ? 0 : value);
  return { ahead: -snapped(y / length) * size + 0, left: -snapped(x / length) * size + 0 };
};

export class Stick {
  /**
   * @param {object} options @param {HTMLElement} options.pad @param {HTMLElement} options.knob
   * @param {(shares: {ahead: number, left: number}) => void} options.emit
   * @param {() => void} options.stop
   */
  constructor({ pad, knob, emit, stop }) {
    this.pad = pad;
    this.knob = knob;
    this.emit = emit;
    this.stop = stop;
    /** @type {number | null} the finger that holds it */
    this.pointer = null;
    this.enabled = false;
    this.methods = ["stick"];
    this.listeners = /** @type {[string, (event: any) => void][]} */ ([
      ["pointerdown", (event) => this.#down(event)],
      ["pointermove", (event) => this.#move(event)],
      ["pointerup", (event) => this.#up(event)],
      ["pointercancel", (event) => this.#cancel(event)],
      ["lostpointercapture", (event) => this.#up(event)],
      ["contextmenu", (event) => event.preventDefault()],
    ]);
  }

  enable() {
    if (!this.enabled) {
      this.enabled = true;
      this.listeners.forEach(([name, listener]) => this.pad.addEventListener(name, listener));
    }
  }

  disable() {
    if (this.enabled) {
      this.enabled = false;
      this.listeners.forEach(([name, listener]) => this.pad.removeEventListener(name, listener));
      this.letGo();
      this.stop();
    }
  }

  letGo() {
    if (this.pointer !== null) {
      this.pointer = null;
      this.#show(0, 0);
      this.emit({ ahead: 0, left: 0 });
    }
  }

  /** @param {PointerEvent} event */
  #down(event) {
    if (this.pointer !== null) {
      return;
    }
    event.preventDefault();
    this.pointer = event.pointerId;
    this.pad.setPointerCapture(event.pointerId);
    this.#move(event);
  }

  /** @param {PointerEvent} event */
  #move(event) {
    if (event.pointerId !== this.pointer) {
      return;
    }
    const box = this.pad.getBoundingClientRect();
    const x = (2 * (event.clientX - box.left)) / box.width - 1;
    const y = (2 * (event.clientY - box.top)) / box.height - 1;
    const bound = 1 / Math.max(1, Math.hypot(x, y));
    this.#show(x * bound, y * bound);
    this.emit(sharesOf(x, y));
  }

  /** @param {PointerEvent} event */
  #up(event) {
    if (event.pointerId === this.pointer) {
      this.letGo();
    }
  }

  /** @param {PointerEvent} event */
  #cancel(event) {
    if (event.pointerId === this.pointer) {
      this.letGo();
      this.stop();
    }
  }

  /** @param {number} x @param {number} y */
  #show(x, y) {
    this.knob.style.setProperty("--push-x", String(x));
    this.knob.style.setProperty("--push-y", String(y));
    this.pad.toggleAttribute("data-held", this.pointer !== null);
  }
}
