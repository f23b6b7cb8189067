/** All controllers of the page, the arbiter between them, and the chosen speed. */

import { Arbiter } from "./arbiter.js";
import { Keyboard } from "./keyboard.js";
import { STEPS, fullSpeeds, toVelocity } from "./speeds.js";
import { Stick } from "./stick.js";

/**
 * @typedef {{methods: string[], enable: () => void, disable: () => void, letGo: () => void,
 *   yields?: boolean}} Controller `yields`: it releases when another one steers
 */

export class Steering {
  /**
   * @param {object} options @param {KeyDispatcher} options.keys
   * @param {HTMLElement} options.pad of the stick
   * @param {HTMLElement} options.knob @param {(intent: Intent) => void} options.onIntent
   * @param {() => void} options.onStop
   * @param {(step: number) => void} options.onStep the visitor chose another speed
   * @param {(method: string) => void} [options.onBarred] the visitor tried a controller that is off
   */
  constructor({ keys, pad, knob, onIntent, onStop, onStep, onBarred = () => undefined }) {
    this.onStep = onStep;
    this.step = 1;
    /** @type {Parameters<typeof fullSpeeds>[0]} */
    this.robotLimits = null;
    this.leaseLimits = { linear: null, angular: null };
    this.enabled = false;
    /** @type {Map<string, {ahead: number, left: number}>} by controller */
    this.shares = new Map();
    this.arbiter = new Arbiter(onIntent);
    this.keyboard = new Keyboard({
      keys,
      emit: (shares) => this.steer("keyboard", shares),
      stop: onStop,
      step: (change) => this.setStep(this.step + change),
      barred: () => onBarred("keyboard"),
    });
    this.stick = new Stick({
      pad,
      knob,
      emit: (shares) => this.steer("stick", shares),
      stop: onStop,
    });
    /** @type {Controller[]} */
    this.known = [this.keyboard, this.stick];
    /** those that may steer */
    this.controllers = this.known;
    /** @type {string[] | null} */
    this.allowed = null;
  }

  /** @param {Controller} controller */
  add(controller) {
    this.known.push(controller);
    this.allow(this.allowed);
    if (this.enabled && this.controllers.includes(controller)) {
      controller.enable();
    }
  }

  /** @param {string[] | null} methods those that may steer, null for all */
  allow(methods) {
    this.allowed = methods;
    this.keyboard.steers = this.mayUse("keyboard");
    this.controllers = this.known.filter(
      (one) => one === this.keyboard || one.methods.some((method) => this.mayUse(method)),
    );
    for (const one of this.known) {
      if (!this.controllers.includes(one)) {
        one.disable();
      }
    }
  }

  /** @param {string} method */
  mayUse(method) {
    return this.allowed?.includes(method) ?? true;
  }

  enable() {
    this.enabled = true;
    this.controllers.forEach((controller) => controller.enable());
  }

  disable() {
    this.enabled = false;
    this.controllers.forEach((controller) => controller.disable());
  }

  /** Every key and pointer counts as released. */
  letGo() {
    this.controllers.forEach((controller) => controller.letGo());
    this.arbiter.release();
  }

  /** @param {number} step index into STEPS */
  setStep(step) {
    this.step = Math.min(STEPS.length - 1, Math.max(0, step));
    this.onStep(this.step);
    const holder = this.arbiter.holder;
    const shares = this.shares.get(holder);
    if (shares) {
      this.steer(holder, shares);
    }
  }

  /** The full speeds now. */
  get full() {
    return fullSpeeds(this.robotLimits, this.leaseLimits, this.step);
  }

  /**
   * A velocity of a controller that has no shares.
   * @param {string} method @param {{linear: number, angular: number}} velocity
   * @returns {boolean} whether it steers now
   */
  drive(method, velocity) {
    this.shares.delete(method);
    this.arbiter.offer(method, velocity);
    return this.arbiter.holder === method;
  }

  /** @param {string} method @param {{ahead: number, left: number}} shares */
  steer(method, shares) {
    const moves = shares.ahead !== 0 || shares.left !== 0;
    // A controller that is held but superseded interrupts no other.
    if (moves && !this.arbiter.outdone.has(method)) {
      this.known.filter(({ yields }) => yields).forEach((one) => one.letGo());
    }
    this.shares.set(method, shares);
    this.arbiter.offer(method, toVelocity(shares, this.full));
  }
}
