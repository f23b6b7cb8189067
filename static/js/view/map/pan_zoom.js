/**
 * The visible part of the map: all of it, a part chosen by hand, or the surroundings of the robot;
 * with the plan's upper side up, or the robot's heading. Pure.
 */

import { fit, toWorld } from "./transform.js";

export const NEAREST = 12; // times as large as the whole
export const FOLLOWING = 2.5;
export const ZOOM_STEP = 1.3; // of a button or a key

/**
 * @typedef {{zoom: number, x: number | null, y: number | null, follows: boolean, turns: boolean}}
 *   ViewSettings x, y: the middle, null for that of the whole
 * @typedef {import("./transform.js").Bounds} Bounds
 */

/** @type {ViewSettings} */
export const ALL = Object.freeze({ zoom: 1, x: null, y: null, follows: false, turns: false });

/**
 * @param {ViewSettings} settings @param {Bounds} bounds
 * @param {{x: number, y: number, theta: number} | null} pose @param {number} width
 * @param {number} height
 * @param {number} [tools] CSS pixels at the upper edge that buttons take
 * @returns {MapView}
 */
export const viewOf = ({ zoom, x, y, follows, turns }, bounds, pose, width, height, tools = 0) => {
  const whole = fit(bounds, width, height - tools);
  const middle = { x: x ?? whole.x, y: y ?? whole.y + tools / 2 / whole.scale };
  const { x: middleX, y: middleY } = follows && pose ? pose : middle;
  const turn = turns && pose ? Math.PI / 2 - pose.theta : 0;
  return { x: middleX, y: middleY, width, height, scale: whole.scale * zoom, turn };
};

/**
 * @param {ViewSettings} settings @param {MapView} view @param {Bounds} bounds
 * @param {number} factor
 * @param {number} [px] what stays where it is, CSS pixels
 * @param {number} [py] @returns {Partial<ViewSettings>}
 */
export const zoomed = (
  settings,
  view,
  bounds,
  factor,
  px = view.width / 2,
  py = view.height / 2,
) => {
  const zoom = Math.max(1, Math.min(NEAREST, settings.zoom * factor));
  if (settings.follows) {
    return { zoom };
  }
  const [x, y] = toWorld(view, px, py);
  const share = settings.zoom / zoom;
  return zoom === 1
    ? { zoom, x: null, y: null }
    : { zoom, ...within(bounds, x + share * (view.x - x), y + share * (view.y - y)) };
};

/**
 * @param {MapView} view @param {Bounds} bounds
 * @param {number} dx CSS pixels that the map moves by
 * @param {number} dy @returns {Partial<ViewSettings>}
 */
export const moved = (view, bounds, dx, dy) => ({
  follows: false,
  ...within(bounds, ...toWorld(view, view.width / 2 - dx, view.height / 2 - dy)),
});

/** The middle stays on the map. @param {Bounds} bounds @param {number} x @param {number} y */
const within = ({ left, right, bottom, top }, x, y) => ({
  x: Math.max(left, Math.min(right, x)),
  y: Math.max(bottom, Math.min(top, y)),
});
