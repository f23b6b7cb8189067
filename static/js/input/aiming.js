/**
 * Choosing a point of the map: press where it is; drag, and the direction of the drag is where the
 * robot will look. Nothing moves by this alone.
 */

const LEAST_DRAG = 16; // CSS pixels; below that a drag is a shaky finger

/**
 * @param {Point} start CSS pixels @param {Point} end
 * @returns {number | null} heading in rad, counter-clockwise from the map's x, null without one
 */
export const headingOf = ([startX, startY], [endX, endY]) => {
  const [dx, dy] = [endX - startX, startY - endY];
  return Math.hypot(dx, dy) < LEAST_DRAG ? null : Math.atan2(dy, dx);
};

export class Aiming {
  /**
   * @param {object} options @param {HTMLElement} options.canvas
   * @param {(px: number, py: number) => Point | null} options.toWorld from CSS pixels of the canvas
   *   to metres
   * @param {(x: number, y: number, theta: number | null) => void} options.onAim again while it is
   *   dragged
   */
  constructor({ canvas, toWorld, onAim }) {
    this.canvas = canvas;
    this.toWorld = toWorld;
    this.onAim = onAim;
    this.enabled = false;
    /** @type {{pointer: number, start: Point} | null} */
    this.held = null;
    this.listeners = /** @type {[string, (event: any) => void][]} */ ([
      ["pointerdown", (event) => this.#down(event)],
      ["pointermove", (event) => this.#move(event)],
      ["pointerup", (event) => this.#up(event)],
      ["pointercancel", (event) => this.#up(event)],
    ]);
  }

  enable() {
    if (!this.enabled) {
      this.enabled = true;
      this.listeners.forEach(([name, listener]) => this.canvas.addEventListener(name, listener));
    }
  }

  disable() {
    if (this.enabled) {
      this.enabled = false;
      this.held = null;
      this.listeners.forEach(([name, listener]) => this.canvas.removeEventListener(name, listener));
    }
  }

  /** The press does not choose a point after all. */
  letGo() {
    this.held = null;
  }

  /** @param {PointerEvent} event */
  #down(event) {
    if (this.held === null && event.button === 0) {
      event.preventDefault();
      this.canvas.setPointerCapture(event.pointerId);
      this.held = { pointer: event.pointerId, start: this.#place(event) };
      this.#move(event);
    }
  }

  /** @param {PointerEvent} event */
  #move(event) {
    if (event.pointerId === this.held?.pointer) {
      const point = this.toWorld(...this.held.start);
      if (point) {
        this.onAim(...point, headingOf(this.held.start, this.#place(event)));
      }
    }
  }

  /** @param {PointerEvent} event */
  #up(event) {
    if (event.pointerId === this.held?.pointer) {
      this.held = null;
    }
  }

  /** @param {PointerEvent} event @returns {Point} */
  #place(event) {
    const box = this.canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }
}
