/**
 * Steering with a finger: a stick on the screen. Its direction is where the robot goes, its
 * deflection how fast.
 */

import { PointerController } from "./pointer_controller.js";

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

export class Stick extends PointerController {
  /**
   * @param {object} options @param {HTMLElement} options.pad @param {HTMLElement} options.knob
   * @param {(shares: {ahead: number, left: number}) => void} options.emit
   * @param {() => void} options.stop
   */
  constructor({ pad, knob, emit, stop }) {
    super(pad);
    this.knob = knob;
    this.emit = emit;
    this.stop = stop;
    this.methods = ["stick"];
    this.listeners.push(["contextmenu", (event) => event.preventDefault()]);
  }

  disable() {
    if (this.enabled) {
      super.disable();
      this.stop();
    }
  }

  /** @param {PointerEvent} event */
  moved(event) {
    const box = this.target.getBoundingClientRect();
    const x = (2 * (event.clientX - box.left)) / box.width - 1;
    const y = (2 * (event.clientY - box.top)) / box.height - 1;
    const bound = 1 / Math.max(1, Math.hypot(x, y));
    this.#show(x * bound, y * bound);
    this.emit(sharesOf(x, y));
  }

  lifted() {
    this.#show(0, 0);
    this.emit({ ahead: 0, left: 0 });
  }

  cancelled() {
    super.cancelled();
    this.stop();
  }

  /** @param {number} x @param {number} y */
  #show(x, y) {
    this.knob.style.setProperty("--push-x", String(x));
    this.knob.style.setProperty("--push-y", String(y));
    this.target.toggleAttribute("data-held", this.pointer !== null);
  }
}
