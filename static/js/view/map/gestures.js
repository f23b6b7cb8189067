/**
 * Moving the map: wheel, two fingers, a drag with the other mouse button, or with one finger where
 * no point can be chosen; and keys, while the map has the focus.
 */

import { isShortcut } from "../../input/key_dispatcher.js";

const STEP = 40; // CSS pixels that a key moves the map
const PANS = /** @type {Record<string, Point>} */ ({
  map_up: [0, STEP],
  map_down: [0, -STEP],
  map_left: [STEP, 0],
  map_right: [-STEP, 0],
});

/**
 * @param {HTMLElement} canvas @param {object} map
 * @param {(factor: number, px?: number, py?: number) => void} map.zoom
 * @param {(dx: number, dy: number) => void} map.pan
 * @param {import("../../input/keymap.js").Keymap} map.keymap
 * @param {Record<string, () => void>} map.actions by their names in the keymap
 * @param {() => boolean} map.mayAim whether one finger, or the first button, chooses a point
 * @param {() => void} map.forgetAim at a second finger: the first one did not choose a point
 */
export const addGestures = (canvas, map) => {
  const { zoom, pan, mayAim, forgetAim } = map;
  /** @type {Map<number, Point>} */
  const fingers = new Map();
  const place = (/** @type {PointerEvent} */ event) =>
    /** @type {Point} */ ([event.offsetX, event.offsetY]);
  const lift = (/** @type {PointerEvent} */ event) => fingers.delete(event.pointerId);

  canvas.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      const steps = Math.max(-200, Math.min(200, event.deltaY));
      zoom(Math.exp(-steps / 400), event.offsetX, event.offsetY);
    },
    { passive: false },
  );
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  // a press does not take the keys away from driving
  canvas.addEventListener("mousedown", (event) => event.preventDefault());
  canvas.addEventListener("pointerdown", (event) => {
    if (fingers.size < 2 && (event.pointerType !== "mouse" || event.button !== 0 || !mayAim())) {
      fingers.set(event.pointerId, place(event));
      canvas.setPointerCapture(event.pointerId);
    }
    if (fingers.size === 2) {
      forgetAim();
    }
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    if (!before || (fingers.size === 1 && event.pointerType !== "mouse" && mayAim())) {
      return;
    }
    const now = place(event);
    fingers.set(event.pointerId, now);
    const [, other] = [...fingers].find(([pointer]) => pointer !== event.pointerId) ?? [];
    if (other) {
      const apart = (/** @type {Point} */ [x, y]) =>
        Math.max(20, Math.hypot(x - other[0], y - other[1]));
      zoom(apart(now) / apart(before), (now[0] + other[0]) / 2, (now[1] + other[1]) / 2);
    }
    const share = fingers.size; // two fingers move the middle between them
    pan((now[0] - before[0]) / share, (now[1] - before[1]) / share);
  });
  canvas.addEventListener("pointerup", lift);
  canvas.addEventListener("pointercancel", lift);
  addKeys(canvas, map);
};

/**
 * @param {HTMLElement} canvas
 * @param {Pick<Parameters<typeof addGestures>[1], "keymap" | "actions" | "pan">} map
 */
const addKeys = (canvas, { keymap, actions, pan }) => {
  canvas.addEventListener("keydown", (event) => {
    if (isShortcut(event)) {
      return; // such as Ctrl and plus, which zooms the page
    }
    const command = keymap.mapCommandOf(event);
    if (command) {
      PANS[command] ? pan(...PANS[command]) : actions[command]();
      event.preventDefault();
    }
  });
};
