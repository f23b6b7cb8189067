/**
 * From metres of the world to pixels of the screen and back. Pure.
 *
 * The world has x to the right and y up; the screen has x to the right and y down, in CSS pixels
 * from the map's top left corner. An image of a map has its lower left corner at `origin` (x, y,
 * theta) and `resolution` metres a pixel, as ROS map_server has it.
 */

/**
 * @typedef {{x: number, y: number, scale: number, width: number, height: number, turn?: number}}
 *   View the world point in the middle, CSS pixels a metre, size, and its counter-clockwise turn,
 *   rad
 * @typedef {{left: number, bottom: number, right: number, top: number}} Bounds metres
 */

/** @param {View} view @param {number} x m @param {number} y m @returns {Point} CSS pixels */
export const toScreen = ({ x: middleX, y: middleY, scale, width, height, turn = 0 }, x, y) => {
  const [dx, dy, cos, sin] = [x - middleX, y - middleY, Math.cos(turn), Math.sin(turn)];
  return [width / 2 + (dx * cos - dy * sin) * scale, height / 2 - (dx * sin + dy * cos) * scale];
};

/** @param {View} view @param {number} px @param {number} py @returns {Point} metres */
export const toWorld = ({ x, y, scale, width, height, turn = 0 }, px, py) => {
  const [right, up] = [(px - width / 2) / scale, (height / 2 - py) / scale];
  const [cos, sin] = [Math.cos(turn), Math.sin(turn)];
  return [x + right * cos + up * sin, y + up * cos - right * sin];
};

/**
 * The view that shows all of `bounds` with a margin.
 * @param {Bounds} bounds
 * @param {number} width CSS pixels
 * @param {number} height
 * @param {number} [margin] CSS pixels
 * @returns {View}
 */
export const fit = (bounds, width, height, margin = 12) => {
  const { left, right, bottom, top } = bounds;
  const across = (width - 2 * margin) / Math.max(right - left, 1e-6);
  const along = (height - 2 * margin) / Math.max(top - bottom, 1e-6);
  const scale = Math.max(1e-3, Math.min(across, along));
  return { x: (left + right) / 2, y: (bottom + top) / 2, scale, width, height };
};

/**
 * The six numbers of canvas.setTransform that draw a map image, whose pixels are 1 × 1, where it
 * belongs.
 * @param {View} view
 * @param {{resolution: number, origin: [number, number, number], height: number}} map height in
 *   image pixels
 * @param {number} density device pixels a CSS pixel
 * @returns {[number, number, number, number, number, number]}
 */
export const imageTransform = (view, { resolution, origin, height }, density) => {
  const [x, y, theta] = origin;
  const step = resolution * view.scale * density;
  const heading = theta + (view.turn ?? 0);
  const [cos, sin] = [Math.cos(heading) * step, Math.sin(heading) * step];
  const [left, bottom] = toScreen(view, x, y);
  // Image u runs along the origin's x axis, v against its y axis; (0, height) is the origin.
  return [cos, -sin, sin, cos, left * density - sin * height, bottom * density - cos * height];
};

/** @param {Iterable<Point>} points @returns {Bounds} */
export const boundsOf = (points) => {
  const bounds = { left: Infinity, bottom: Infinity, right: -Infinity, top: -Infinity };
  for (const [x, y] of points) {
    bounds.left = Math.min(bounds.left, x);
    bounds.right = Math.max(bounds.right, x);
    bounds.bottom = Math.min(bounds.bottom, y);
    bounds.top = Math.max(bounds.top, y);
  }
  return bounds;
};
