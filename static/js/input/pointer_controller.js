/**
 * A controller for one pointer: it follows the pointer that was pressed on its element until that
 * is lifted, and ignores all others.
 */
export class PointerController {
  enabled = false;
  /** @type {number | null} the id of the pressed pointer */
  pointer = null;

  /** @param {HTMLElement} target */
  constructor(target) {
    this.target = target;
    this.listeners = /** @type {[string, (event: any) => void][]} */ ([
      ["pointerdown", (event) => this.#down(event)],
      ["pointermove", (event) => this.#isOwn(event) && this.moved(event)],
      ["pointerup", (event) => this.#isOwn(event) && this.#lift(event)],
      ["pointercancel", (event) => this.#isOwn(event) && this.cancelled()],
      ["lostpointercapture", (event) => this.#isOwn(event) && this.letGo()],
    ]);
  }

  enable() {
    if (!this.enabled) {
      this.enabled = true;
      this.listeners.forEach(([name, listener]) => this.target.addEventListener(name, listener));
    }
  }

  disable() {
    if (this.enabled) {
      this.enabled = false;
      this.listeners.forEach(([name, listener]) => this.target.removeEventListener(name, listener));
      this.letGo();
    }
  }

  /** The pointer counts as lifted. */
  letGo() {
    if (this.pointer !== null) {
      this.#lift(null);
    }
  }

  /** @param {PointerEvent} event @returns {boolean} whether the press counts */
  pressed(event) {
    event.preventDefault();
    return true;
  }

  /** At the press and with each move; for subclasses. @param {PointerEvent} event */
  moved(event) {
    void event;
  }

  /** For subclasses. @param {PointerEvent | null} event null when the press was interrupted */
  lifted(event) {
    void event;
  }

  /** The browser has taken the pointer away. */
  cancelled() {
    this.letGo();
  }

  /** @param {PointerEvent} event @returns {Point} CSS pixels of the element */
  placeOf({ clientX, clientY }) {
    const box = this.target.getBoundingClientRect();
    return [clientX - box.left, clientY - box.top];
  }

  /** @param {PointerEvent} event */
  #isOwn({ pointerId }) {
    return pointerId === this.pointer;
  }

  /** @param {PointerEvent} event */
  #down(event) {
    if (this.pointer === null && event.button === 0 && this.pressed(event)) {
      this.pointer = event.pointerId;
      this.target.setPointerCapture(event.pointerId);
      this.moved(event);
    }
  }

  /** @param {PointerEvent | null} event */
  #lift(event) {
    this.pointer = null;
    this.lifted(event);
  }
}
