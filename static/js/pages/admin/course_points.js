/** Points of a course in the fields of its form, in metres. Pure. */

import { readDecimal } from "../../lib/decimal.js";
import { distanceTo } from "../../lib/swept_path.js";

const NEAR = 0.4; // m: a click so near to a line of the path is inserted into it

/**
 * @param {string} text one point a line, "x y"
 * @param {string} [language] without it the page's
 * @returns {Point[] | null} null when a line is no point
 */
export const parsePoints = (text, language) => {
  const lines = text
    .split("\n")
    .map((line) => line.trim())
    .filter(Boolean);
  const points = lines.map((line) =>
    line.split(/[\s;]+/).map((word) => readDecimal(word, language)),
  );
  return points.every((point) => point.length === 2 && point.every(Number.isFinite))
    ? /** @type {Point[]} */ (points)
    : null;
};

/** @param {Point[]} points @returns {string} */
export const formatPoints = (points) =>
  points.map(([x, y]) => `${rounded(x)} ${rounded(y)}`).join("\n");

/** @param {number} value m @returns {number} to the centimetre */
export const rounded = (value) => Math.round(value * 100) / 100 + 0;

/**
 * The points with a new one: in the line of the path that is near to it, else at the end.
 * @param {Point[]} points @param {Point} point @returns {Point[]}
 */
export const withPoint = (points, point) => {
  const distances = points.slice(1).map((to, n) => distanceTo(point, points[n], to));
  const nearest = distances.indexOf(Math.min(...distances));
  const place = distances.length && distances[nearest] <= NEAR ? nearest + 1 : points.length;
  return [...points.slice(0, place), point, ...points.slice(place)];
};

/** @param {Point[]} points @param {number} n @param {Point} point @returns {Point[]} */
export const withMoved = (points, n, point) =>
  points.map((old, index) => (index === n ? point : old));

/**
 * @param {Point[]} points @param {number} n
 * @param {number} least how many must stay
 * @returns {Point[]}
 */
export const without = (points, n, least) =>
  points.length > least ? points.filter((_, index) => index !== n) : points;

/**
 * The step of an arrow key.
 * @param {string} key @param {boolean} small
 * @returns {Point | null} m
 */
export const stepOf = (key, small) => {
  const step = small ? 0.02 : 0.1;
  /** @type {Record<string, Point>} */
  const steps = {
    ArrowLeft: [-step, 0],
    ArrowRight: [step, 0],
    ArrowUp: [0, step],
    ArrowDown: [0, -step],
  };
  return steps[key] ?? null;
};
