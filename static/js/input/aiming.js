/**
 * Choosing a point of the map: a press marks it, and dragging sets the heading that the robot shall
 * have there. Nothing moves by this alone.
 */

import { PointerController } from "./pointer_controller.js";

const LEAST_DRAG = 16; // CSS pixels; less is a shaky finger

/**
 * @param {Point} start CSS pixels @param {Point} end
 * @returns {number | null} heading in rad, counter-clockwise from the map's x, null without one
 */
export const headingOf = ([startX, startY], [endX, endY]) => {
  const [dx, dy] = [endX - startX, startY - endY];
  return Math.hypot(dx, dy) < LEAST_DRAG ? null : Math.atan2(dy, dx);
};

export class Aiming extends PointerController {
  /**
   * @param {object} options @param {HTMLElement} options.canvas
   * @param {(px: number, py: number) => Point | null} options.toWorld from CSS pixels of the canvas
   *   to metres
   * @param {(x: number, y: number, theta: number | null) => void} options.onAim repeated while it
   *   is dragged
   */
  constructor({ canvas, toWorld, onAim }) {
    super(canvas);
    this.toWorld = toWorld;
    this.onAim = onAim;
    /** @type {Point} */
    this.start = [0, 0];
  }

  /** @param {PointerEvent} event */
  pressed(event) {
    this.start = this.placeOf(event);
    return super.pressed(event);
  }

  /** @param {PointerEvent} event */
  moved(event) {
    const point = this.toWorld(...this.start);
    if (point) {
      this.onAim(...point, headingOf(this.start, this.placeOf(event)));
    }
  }
}
