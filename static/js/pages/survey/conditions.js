/**
 * Which questions of the page are shown, from the answers on it, as in surveys/conditions.py. A
 * hidden question counts as unanswered for those that depend on it.
 */

import { readDecimal } from "../../lib/decimal.js";

/**
 * @typedef {{ item: string, is: (string | number)[], at_least: number | null,
 *   at_most: number | null }} Condition
 */

/**
 * @param {Condition} condition
 * @param {string[]} said values of the question's controls; none is no answer
 */
const answerFits = (condition, said) => {
  const values = said.filter((value) => value !== "" && !value.startsWith("~"));
  if (values.length === 0) return false;
  if (condition.is.length > 0)
    return values.some((value) => condition.is.some((one) => sameValue(one, value)));
  const number = readDecimal(values[0]);
  if (!Number.isFinite(number)) return false;
  return (
    (condition.at_least === null || number >= condition.at_least) &&
    (condition.at_most === null || number <= condition.at_most)
  );
};

/** @param {string | number} one @param {string} value */
const sameValue = (one, value) =>
  typeof one === "number" ? readDecimal(value) === one : one === value;

/**
 * @param {{ key: string, condition: Condition | null }[]} questions in written order
 * @param {(key: string) => string[]} said
 * @returns {Set<string>} the keys of those that are shown
 */
export const shownKeys = (questions, said) => {
  const shown = new Set();
  for (const { key, condition } of questions) {
    if (
      condition === null ||
      (shown.has(condition.item) && answerFits(condition, said(condition.item)))
    )
      shown.add(key);
  }
  return shown;
};
