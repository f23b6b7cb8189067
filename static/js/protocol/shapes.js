/**
 * Checks of messages, for messages.js. A shape is a function that returns the value, with defaults
 * filled in, or throws a ShapeError. Unknown fields are dropped.
 */

export class ShapeError extends Error {}

/** @typedef {(value: unknown) => any} Shape */

/** @param {string} wanted @returns {never} */
const fail = (wanted) => {
  throw new ShapeError(wanted);
};

/** @param {number} least @param {number} most @returns {Shape} */
export const number = (least, most) => (value) =>
  typeof value === "number" && value >= least && value <= most
    ? value
    : fail(`a number from ${least} to ${most}`);

/** @param {number} least @param {number} most @returns {Shape} */
export const integer = (least, most) => (value) =>
  Number.isSafeInteger(value) && Number(value) >= least && Number(value) <= most
    ? value
    : fail(`an integer from ${least} to ${most}`);

/** @param {number} longest @param {number} [shortest] @returns {Shape} */
export const text =
  (longest, shortest = 0) =>
  (value) =>
    typeof value === "string" && value.length <= longest && value.length >= shortest
      ? value
      : fail(`text of ${shortest} to ${longest}`);

/** @param {RegExp} pattern @returns {Shape} */
export const matching = (pattern) => (value) =>
  typeof value === "string" && pattern.test(value) ? value : fail(`text like ${pattern}`);

/** @type {Shape} */
export const flag = (value) => (typeof value === "boolean" ? value : fail("true or false"));

/** @type {Shape} */
export const scalar = (value) =>
  typeof value === "object" && value !== null ? fail("no list and no object") : value;

/** @param {string[]} words @returns {Shape} */
export const oneOf =
  (...words) =>
  (value) =>
    typeof value === "string" && words.includes(value) ? value : fail(words.join(" or "));

/** @param {Shape} shape @returns {Shape} */
export const nullable = (shape) => (value) => (value === null ? null : shape(value));

/** @param {Shape} shape @param {number} longest @param {number} [shortest] @returns {Shape} */
export const list =
  (shape, longest, shortest = 0) =>
  (value) =>
    Array.isArray(value) && value.length >= shortest && value.length <= longest
      ? value.map(shape)
      : fail(`a list of ${shortest} to ${longest}`);

/** @param {Shape[]} shapes @returns {Shape} */
export const tuple =
  (...shapes) =>
  (value) =>
    Array.isArray(value) && value.length === shapes.length
      ? shapes.map((shape, i) => shape(value[i]))
      : fail(`a list of ${shapes.length}`);

/** @param {Shape} shape @param {number} most @returns {Shape} */
export const dictionary = (shape, most) => (value) => {
  const entries = isObject(value) ? Object.entries(value) : fail("an object");
  return entries.length <= most
    ? Object.fromEntries(entries.map(([key, one]) => [key, shape(one)]))
    : fail(`at most ${most} entries`);
};

const DEFAULT = Symbol("default");

/** A field that may be left out. @param {Shape} shape @param {unknown} value what it is then */
export const optional = (shape, value) =>
  Object.assign((/** @type {unknown} */ given) => shape(given), { [DEFAULT]: () => shape(value) });

/** A field that is null unless it is there. @param {Shape} shape */
export const absent = (shape) => optional(nullable(shape), null);

/** @param {Record<string, Shape>} fields @returns {Shape} */
export const object = (fields) => (value) => {
  if (!isObject(value)) {
    return fail("an object");
  }
  const message = /** @type {Record<string, unknown>} */ ({});
  for (const [name, shape] of Object.entries(fields)) {
    message[name] = field(name, shape, value);
  }
  return message;
};

/**
 * @param {string} tag the field that tells which
 * @param {Record<string, Shape>} shapes @returns {Shape}
 */
export const tagged = (tag, shapes) => (value) => {
  const name = isObject(value) ? value[tag] : fail("an object");
  const shape =
    typeof name === "string" && Object.hasOwn(shapes, name)
      ? shapes[name]
      : fail(`${tag}: ${Object.keys(shapes).join(" or ")}`);
  return { [tag]: name, ...shape(value) };
};

/** @param {string} name @param {any} shape @param {Record<string, unknown>} value */
const field = (name, shape, value) => {
  if (!Object.hasOwn(value, name)) {
    return DEFAULT in shape ? shape[DEFAULT]() : fail(`${name} is missing`);
  }
  try {
    return shape(value[name]);
  } catch (error) {
    throw error instanceof ShapeError ? new ShapeError(`${name}: ${error.message}`) : error;
  }
};

/** @param {unknown} value @returns {value is Record<string, unknown>} */
const isObject = (value) => typeof value === "object" && value !== null && !Array.isArray(value);
