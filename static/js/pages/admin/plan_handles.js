/** The handles of a plan, which read and write the fields of its form. */

import { readDecimal } from "../../lib/decimal.js";
import { rounded } from "./course_points.js";

/**
 * @typedef {object} Handle
 * @property {string} id
 * @property {string} kind opening, dock, heading, place or checkpoint
 * @property {string} label
 * @property {string} part
 * @property {Point} at m
 * @property {(at: Point) => void} move
 * @property {(() => void) | null} remove
 * @property {string} [number]
 * @property {string} [name] shown beside it on the map
 * @property {string} [route] of checkpoints that are visited one after the other
 */
/**
 * @typedef {{read: (name: string) => string | null, write: (name: string, value: string) => void}}
 *   Fields
 * @typedef {{part: string, kind: string, label: string} & Partial<
 *   Record<"number" | "name" | "route", string>>} Part a fieldset of the page
 */

export const AHEAD = 0.6; // m from a dock to the handle of its direction

/** @param {string | null} text @returns {number} */
const number = (text) => readDecimal(text ?? "");

/** @param {number} degrees @returns {number} in (-180, 180], to a tenth */
export const wrapped = (degrees) =>
  Math.round((((((degrees + 180) % 360) + 360) % 360) - 180) * 10) / 10 + 0;

/** @param {Point} at @param {number} degrees @returns {Point} */
export const ahead = ([x, y], degrees) => [
  x + AHEAD * Math.cos((degrees * Math.PI) / 180),
  y + AHEAD * Math.sin((degrees * Math.PI) / 180),
];

/**
 * The handle of a point, null without one.
 * @param {Part} part @param {Fields} fields @param {string[]} names @param {string} label
 * @returns {Handle | null}
 */
export const spot = ({ part, kind, number: shown }, fields, names, label) => {
  const at = /** @type {Point} */ (names.map((name) => number(fields.read(`${part}.${name}`))));
  if (!at.every(Number.isFinite)) {
    return null;
  }
  return {
    id: `${part}.${names[0]}`,
    kind,
    label,
    part,
    at,
    number: shown,
    remove: () => fields.write(`${part}.remove`, "on"),
    move: (to) =>
      names.forEach((name, axis) => fields.write(`${part}.${name}`, String(rounded(to[axis])))),
  };
};

/**
 * @param {Part} part @param {Fields} fields @param {Handle} dock @param {string} word
 * @returns {Handle[]}
 */
const heading = ({ part, label }, fields, dock, word) => {
  const name = `${part}.heading`;
  const degrees = number(fields.read(name));
  if (!Number.isFinite(degrees)) {
    return [];
  }
  const at = ahead(dock.at, degrees);
  const move = (/** @type {Point} */ [x, y]) => {
    const turn = Math.atan2(y - dock.at[1], x - dock.at[0]);
    fields.write(name, String(wrapped((turn * 180) / Math.PI)));
  };
  return [{ id: name, kind: "heading", label: `${label}, ${word}`, part, at, remove: null, move }];
};

/**
 * The handles of a part, none when it is removed or has no numbers.
 * @param {Part} part @param {Fields} fields @param {{end: string, heading: string}} words
 * @returns {Handle[]}
 */
export const handlesOf = (part, fields, words) => {
  if (fields.read(`${part.part}.remove`)) {
    return [];
  }
  const point = spot(part, fields, ["x", "y"], part.label);
  if (!point) {
    return [];
  }
  const first = { ...point, name: part.name, route: part.route };
  if (part.kind === "dock") {
    return [first, ...heading(part, fields, first, words.heading)];
  }
  const second =
    part.kind === "opening"
      ? spot(part, fields, ["x2", "y2"], `${part.label}, ${words.end}`)
      : null;
  return second ? [first, second] : [first];
};
