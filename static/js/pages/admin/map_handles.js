/** Handles on a map of the administration, moved by a mouse, a finger or keys. */

import { isShortcut } from "../../input/key_dispatcher.js";
import { element, UNIT } from "./course_ground.js";
import { stepOf } from "./course_points.js";

/**
 * @typedef {{at: Point, move: (at: Point) => void, remove: (() => void) | null}} Movable positions
 *   in metres
 */

export const GRIP = 22; // CSS px: half of what a finger hits

/** Where an event is on the map. @param {any} svg @param {MouseEvent} event @returns {Point} m */
export const pointAt = (svg, event) => {
  const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(
    svg.getScreenCTM().inverse(),
  );
  return [point.x / UNIT, -point.y / UNIT];
};

/**
 * @typedef {{now: () => Movable, mayChange: () => boolean, worldAt: (event: MouseEvent) => Point,
 *   onFocus: () => void}} Moving
 */

/** @param {PointerEvent} event @param {SVGElement} group @param {Moving} moving */
const drag = (event, group, { now, mayChange, worldAt }) => {
  if (event.button !== 0 || !mayChange()) {
    return;
  }
  event.preventDefault();
  group.focus();
  group.setPointerCapture(event.pointerId);
  const grip = worldAt(event);
  const from = now().at;
  const follow = (/** @type {PointerEvent} */ moved) => {
    const to = worldAt(moved);
    now().move([from[0] + to[0] - grip[0], from[1] + to[1] - grip[1]]);
  };
  const over = new AbortController();
  group.addEventListener("pointermove", follow, over);
  group.addEventListener("lostpointercapture", () => over.abort(), over);
};

/**
 * A group to draw a handle into; `now` gives what it moves.
 * @param {Moving} moving @returns {SVGElement}
 */
export const movable = (moving) => {
  const group = element("g", { class: "course__handle", tabindex: 0, role: "button" });
  group.addEventListener("pointerdown", (event) => drag(event, group, moving));
  group.addEventListener("keydown", (event) => {
    const step = stepOf(event.key, event.shiftKey);
    if (!moving.mayChange() || isShortcut(event) || (!step && event.key !== "Delete")) {
      return;
    }
    event.preventDefault();
    const { at, move, remove } = moving.now();
    if (step) {
      move([at[0] + step[0], at[1] + step[1]]);
    } else {
      remove?.();
    }
  });
  group.addEventListener("focus", moving.onFocus);
  return group;
};
