/**
 * Steering with a gamepad of the standard mapping (w3.org/TR/gamepad). One stick drives: the left
 * one, until the visitor presses the right one down. The lower and the right button stop the robot,
 * the shoulder buttons choose the speed. Gamepads send no events, so they are polled once a frame
 * while one is connected.
 */

import { sharesOf } from "./stick.js";

const STOP_BUTTONS = [0, 1];
const SLOWER = 4;
const FASTER = 5;
const PRESSED_STICKS = /** @type {[number, "left" | "right"][]} */ ([
  [10, "left"],
  [11, "right"],
]);

export class Gamepads {
  /**
   * @param {object} options @param {(shares: {ahead: number, left: number}) => void} options.emit
   * @param {() => void} options.stop @param {(change: number) => void} options.step
   * @param {(pad: {there: boolean, stick: "left" | "right", standard: boolean}) => void}
   *   options.onPad plugged in, pulled out, or its sticks were swapped
   * @param {EventTarget} [options.target] @param {() => (Gamepad | null)[]} [options.list]
   * @param {(callback: () => void) => unknown} [options.frame]
   */
  constructor({
    emit,
    stop,
    step,
    onPad,
    target = window,
    list = () => navigator.getGamepads?.() ?? [],
    frame = (callback) => requestAnimationFrame(callback),
  }) {
    this.emit = emit;
    this.stop = stop;
    this.step = step;
    this.onPad = onPad;
    this.list = list;
    this.frame = frame;
    this.methods = ["gamepad"];
    this.enabled = false;
    /** @type {"left" | "right"} */
    this.stick = "left";
    /** @type {number | null} */
    this.index = null;
    this.running = false;
    this.still = true;
    /** false until a stick that was held when input was released is at rest */
    this.armed = false;
    /** @type {Set<number>} */
    this.down = new Set();
    target.addEventListener("gamepadconnected", (/** @type {any} */ { gamepad }) =>
      this.#plug(gamepad),
    );
    target.addEventListener("gamepaddisconnected", (/** @type {any} */ { gamepad }) =>
      this.#pull(gamepad.index),
    );
  }

  enable() {
    this.enabled = true;
    this.armed = false;
    const pad = this.list().find((one) => one?.mapping === "standard");
    if (this.index === null && pad) {
      this.#plug(pad);
    }
    this.#run();
  }

  disable() {
    if (this.enabled) {
      this.enabled = false;
      this.letGo();
      if (this.index !== null) {
        this.stop();
      }
    }
  }

  letGo() {
    this.armed = false;
    if (!this.still) {
      this.still = true;
      this.emit({ ahead: 0, left: 0 });
    }
  }

  /** @param {Gamepad} pad */
  #plug({ index, mapping }) {
    const standard = mapping === "standard";
    if (this.index === null) {
      this.index = standard ? index : null;
      this.onPad({ there: standard, stick: this.stick, standard });
      this.#run();
    }
  }

  /** @param {number} index */
  #pull(index) {
    if (index === this.index) {
      const drove = !this.still;
      this.index = null;
      this.letGo();
      if (drove) {
        this.stop();
      }
      this.onPad({ there: false, stick: this.stick, standard: true });
    }
  }

  #run() {
    if (!this.running && this.enabled && this.index !== null) {
      this.running = true;
      this.frame(() => this.#poll());
    }
  }

  #poll() {
    this.running = false;
    const pad = this.index === null ? null : this.list()[this.index];
    if (!pad || !this.enabled) {
      return;
    }
    this.#buttons(pad.buttons);
    const axis = this.stick === "left" ? 0 : 2;
    const shares = sharesOf(pad.axes[axis] ?? 0, pad.axes[axis + 1] ?? 0);
    const still = shares.ahead === 0 && shares.left === 0;
    this.armed ||= still;
    if (this.armed && !(still && this.still)) {
      this.still = still;
      this.emit(shares);
    }
    this.#run();
  }

  /** @param {readonly GamepadButton[]} buttons */
  #buttons(buttons) {
    buttons.forEach(({ pressed }, button) => {
      if (pressed && !this.down.has(button)) {
        this.down.add(button);
        this.#press(button);
      } else if (!pressed) {
        this.down.delete(button);
      }
    });
  }

  /** @param {number} button */
  #press(button) {
    const [, stick] = PRESSED_STICKS.find(([one]) => one === button) ?? [];
    if (STOP_BUTTONS.includes(button)) {
      this.stop();
    } else if (button === SLOWER || button === FASTER) {
      this.step(button === FASTER ? 1 : -1);
    } else if (stick && stick !== this.stick) {
      this.letGo();
      this.stick = stick;
      this.onPad({ there: true, stick, standard: true });
    }
  }
}
