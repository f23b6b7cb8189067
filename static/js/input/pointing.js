/**
 * Driving by pressing on the picture. Press and the way is shown, release and the robot drives
 * there; drag to correct. Hold still and it drives towards the finger for as long as it is held.
 *
 * Here is only the hand: where it is and what it means. Where that is on the floor others know.
 */

export const HOLD_SECONDS = 0.7;
const STEADY = 10; // CSS pixels; a hand that moves further is still aiming

/**
 * @typedef {{px: number, py: number, method: "mouse" | "touch"}} Press CSS pixels of the picture's
 *   element
 */

export class Pointing {
  /**
   * @param {object} options @param {HTMLElement} options.stage
   * @param {(press: Press) => void} options.onAim again whenever it changes
   * @param {(press: Press) => void} options.onGo
   * @param {(press: Press) => void} options.onHold again and again while it is held; call `tick`
   *   for that
   * @param {(wasHeld: boolean) => void} options.onEnd the press is over, without a wish to go
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
    this.stage = stage;
    this.onAim = onAim;
    this.onGo = onGo;
    this.onHold = onHold;
    this.onEnd = onEnd;
    this.allowed = allowed;
    this.barred = barred;
    this.stop = stop;
    this.now = now;
    this.methods = ["mouse", "touch"];
    this.enabled = false;
    /** @type {{pointer: number, press: Press, at: number, from: Point, held: boolean} | null} */
    this.pressed = null;
    this.listeners = /** @type {[string, (event: any) => void][]} */ ([
      ["pointerdown", (event) => this.#down(event)],
      ["pointermove", (event) => this.#move(event)],
      ["pointerup", (event) => this.#up(event)],
      ["pointercancel", (event) => this.#cancel(event)],
    ]);
  }

  enable() {
    if (!this.enabled) {
      this.enabled = true;
      this.listeners.forEach(([name, listener]) => this.stage.addEventListener(name, listener));
    }
  }

  disable() {
    if (this.enabled) {
      this.enabled = false;
      this.listeners.forEach(([name, listener]) => this.stage.removeEventListener(name, listener));
      this.letGo();
      this.stop();
    }
  }

  letGo() {
    const { pressed } = this;
    this.pressed = null;
    if (pressed) {
      this.onEnd(pressed.held);
    }
  }

  outdone() {
    this.letGo();
  }

  /** Detects a press that is held; call it often. */
  tick() {
    const { pressed } = this;
    if (pressed && (pressed.held || this.now() - pressed.at > 1000 * HOLD_SECONDS)) {
      pressed.held = true;
      this.onHold(pressed.press);
    }
  }

  /** @param {PointerEvent} event */
  #down(event) {
    const { target } = event;
    if (
      this.pressed ||
      event.button !== 0 ||
      !(target === this.stage || /** @type {Element} */ (target).matches("video, canvas"))
    ) {
      return;
    }
    const press = this.#press(event);
    if (!this.allowed(press.method)) {
      this.barred(press.method);
      return;
    }
    this.stage.setPointerCapture(event.pointerId);
    this.pressed = {
      pointer: event.pointerId,
      press,
      at: this.now(),
      from: [press.px, press.py],
      held: false,
    };
    this.onAim(press);
  }

  /** @param {PointerEvent} event */
  #move(event) {
    const { pressed } = this;
    if (pressed?.pointer !== event.pointerId) {
      return;
    }
    pressed.press = this.#press(event);
    const { px, py } = pressed.press;
    if (!pressed.held && Math.hypot(px - pressed.from[0], py - pressed.from[1]) > STEADY) {
      pressed.from = [px, py];
      pressed.at = this.now();
    }
    this.onAim(pressed.press);
  }

  /** @param {PointerEvent} event */
  #up(event) {
    const { pressed } = this;
    if (pressed?.pointer === event.pointerId) {
      this.pressed = null;
      this.onEnd(pressed.held);
      if (!pressed.held) {
        this.onGo(this.#press(event));
      }
    }
  }

  /** @param {PointerEvent} event */
  #cancel(event) {
    if (this.pressed?.pointer === event.pointerId) {
      this.letGo();
      this.stop();
    }
  }

  /** @param {PointerEvent} event @returns {Press} */
  #press({ clientX, clientY, pointerType }) {
    const box = this.stage.getBoundingClientRect();
    return {
      px: clientX - box.left,
      py: clientY - box.top,
      method: pointerType === "mouse" ? "mouse" : "touch",
    };
  }
}
