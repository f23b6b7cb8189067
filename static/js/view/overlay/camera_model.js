/**
 * From the floor to the video and back. Pure.
 *
 * The camera is a pinhole with square pixels and its principal point in the middle
 * (robots/api/messages.py, Camera): `x` before the robot's centre, `z` above the floor, and turned
 * down by `pitch` and the head's tilt, p together. Pixels count from the upper left corner, u to
 * the right and v down, in the camera's own size. A point at (forward, left) of the lens on the
 * floor has the depth cos p * forward + sin p * z, and is `left` beside and sin p * forward - cos p
 * * z above the axis.
 */

/**
 * @typedef {{width: number, height: number, hfov: number, x: number, z: number, pitch?: number}}
 *   Camera of the factsheet
 * @typedef {{left: number, top: number, scale: number, width: number, height: number}} Box of a
 *   picture in its element, CSS pixels: its corner, the size of a pixel, and that of the element
 * @typedef {Point | [number, number, number]} Spot m, robot's frame, on the floor or at that height
 */

/** @param {Camera} camera @returns {number} in pixels */
const focalOf = ({ width, hfov }) => width / 2 / Math.tan(hfov / 2);

/**
 * The depth of a point, m, negative behind the lens.
 * @param {Camera} camera @param {number} tilt rad @param {Spot} spot
 */
export const depthOf = ({ x, z, pitch = 0 }, tilt, [forward, , up = 0]) =>
  Math.cos(pitch + tilt) * (forward - x) + Math.sin(pitch + tilt) * (z - up);

/**
 * @param {Camera} camera @param {number} tilt of the head, rad, positive looks down
 * @param {Spot} spot before the lens
 * @returns {Point} u, v
 */
export const toPicture = (camera, tilt, spot) => {
  const [focal, p] = [focalOf(camera), (camera.pitch ?? 0) + tilt];
  const depth = depthOf(camera, tilt, spot);
  const above = Math.sin(p) * (spot[0] - camera.x) - Math.cos(p) * (camera.z - (spot[2] ?? 0));
  return [
    camera.width / 2 - (focal * spot[1]) / depth,
    camera.height / 2 - (focal * above) / depth,
  ];
};

/**
 * @param {Camera} camera @param {number} tilt
 * @param {Point} pixel u, v
 * @returns {Point | null} m, on the floor, robot's frame; null at the horizon and above it
 */
export const toFloor = (camera, tilt, [u, v]) => {
  const [focal, p] = [focalOf(camera), (camera.pitch ?? 0) + tilt];
  const [right, down] = [(u - camera.width / 2) / focal, (v - camera.height / 2) / focal];
  const sinks = Math.sin(p) + down * Math.cos(p);
  if (!(sinks > 1e-3)) {
    return null;
  }
  const share = camera.z / sinks;
  return [camera.x + share * (Math.cos(p) - down * Math.sin(p)), -share * right];
};

/**
 * The box of a picture in an element that shows it by `object-fit`.
 * @param {{width: number, height: number}} picture
 * @param {number} width CSS pixels of the element
 * @param {number} height @param {string} fit @returns {Box}
 */
export const boxOf = (picture, width, height, fit) => {
  const ratios = [width / picture.width, height / picture.height];
  const scale = fit === "cover" ? Math.max(...ratios) : Math.min(...ratios);
  const [left, top] = [(width - scale * picture.width) / 2, (height - scale * picture.height) / 2];
  return { left, top, scale, width, height };
};

/** @param {Box} box @param {Point} pixel @returns {Point} CSS pixels of the element */
export const toElement = ({ left, top, scale }, [u, v]) => [left + scale * u, top + scale * v];

/** @param {Box} box @param {Point} place @returns {Point} pixel of the picture */
export const fromElement = ({ left, top, scale }, [px, py]) => [
  (px - left) / scale,
  (py - top) / scale,
];

const SIDE = 0.07; // of the picture's width
const FINGER = 44; // CSS pixels

/**
 * Whether a press is at a side of the picture, or beside it: 1 for left, -1 for right, 0 for
 * neither.
 * @param {Box} box @param {{width: number}} picture
 * @param {number} px CSS pixels of the element
 */
export const sideOf = ({ left, scale, width }, picture, px) => {
  const [from, to] = [Math.max(0, left), Math.min(width, left + scale * picture.width)];
  const edge = Math.max(FINGER, SIDE * (to - from));
  return px < from + edge ? 1 : px > to - edge ? -1 : 0;
};
