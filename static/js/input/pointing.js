/**
 * Driving by pressing on the video. A press shows the path, its release makes the robot drive, and
 * dragging corrects the point. While a press is held still, the robot drives towards it.
 * floor_press.js works out where on the floor that is.
 */

import { PointerController } from "./pointer_controller.js";

export const HOLD_SECONDS = 0.7;
const STEADY = 10; // CSS pixels; a pointer that moves further is still aiming

/** @typedef {{px: number, py: number, method: "mouse" | "touch"}} Press CSS pixels of the stage */

export class Pointing extends PointerController {
  /**
   * @param {object} options @param {HTMLElement} options.stage
   * @param {(press: Press) => void} options.onAim at the press and with each move
   * @param {(press: Press) => void} options.onGo
   * @param {(press: Press) => boolean} options.onHold repeated by `tick` while it is held; whether
   *   the robot drives: one that does not is sent there by the release
   * @param {(wasHeld: boolean) => void} options.onEnd the press is over
   * @param {(method: string) => boolean} options.allowed
   * @param {(method: string) => void} options.barred @param {() => void} options.stop
   * @param {() => number} [options.now] ms
   */
  constructor({
    stage,
    onAim,
    onGo,
    onHold,
    onEnd,
    allowed,
    barred,
    stop,
    now = () => performance.now(),
  }) {
    super(stage);
    this.onAim = onAim;
    this.onGo = onGo;
    this.onHold = onHold;
    this.onEnd = onEnd;
    this.allowed = allowed;
    this.barred = barred;
    this.stop = stop;
    this.now = now;
    this.methods = ["mouse", "touch"];
    this.yields = true;
    this.press = /** @type {Press} */ ({ px: 0, py: 0, method: "mouse" });
    this.steadyAt = 0; // ms: since when it has not moved away from `from`
    this.from = this.press;
    this.held = false;
  }

  disable() {
    if (this.enabled) {
      super.disable();
      this.stop();
    }
  }

  /** Detects a press that is held; call it often. */
  tick() {
    if (this.pointer !== null && (this.held || this.now() - this.steadyAt > 1000 * HOLD_SECONDS)) {
      this.held = this.onHold(this.press) || this.held;
    }
  }

  /** @param {PointerEvent} event */
  pressed(event) {
    const target = /** @type {Element} */ (event.target);
    if (target !== this.target && !target.matches("video, canvas")) {
      return false;
    }
    const press = this.#pressOf(event);
    if (!this.allowed(press.method)) {
      this.barred(press.method);
      return false;
    }
    Object.assign(this, { from: press, steadyAt: this.now(), held: false });
    return true;
  }

  /** @param {PointerEvent} event */
  moved(event) {
    const { from } = this;
    this.press = this.#pressOf(event);
    const { px, py } = this.press;
    if (!this.held && Math.hypot(px - from.px, py - from.py) > STEADY) {
      Object.assign(this, { from: this.press, steadyAt: this.now() });
    }
    this.onAim(this.press);
  }

  /** @param {PointerEvent | null} event */
  lifted(event) {
    this.onEnd(this.held);
    if (event && !this.held) {
      this.onGo(this.#pressOf(event));
    }
  }

  cancelled() {
    super.cancelled();
    this.stop();
  }

  /** @param {PointerEvent} event @returns {Press} */
  #pressOf(event) {
    const [px, py] = this.placeOf(event);
    return { px, py, method: event.pointerType === "mouse" ? "mouse" : "touch" };
  }
}
