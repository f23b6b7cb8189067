/**
 * What a robot reports about why it does not go on (robots/api/reasons.py), in the page's words.
 * Pure.
 */

import { REASONS } from "../protocol/messages.js";

/**
 * A reason is a code, or a code, a colon and its value. The text of an adapter or an older agent is
 * shown as it is, a code of a newer one with spaces.
 * @param {string} reason
 * @returns {{word: string, values: Record<string, string>} | null} null when there is no reason
 */
export const reasonFor = (reason) => {
  const [code, ...rest] = reason.split(": ");
  const value = rest.join(": ");
  if (REASONS.has(code)) {
    return { word: `reason.${code}`, values: { what: value } };
  }
  const readable = code.includes(" ") ? code : code.replaceAll("_", " ");
  const what = [readable, ...rest].join(": ").replace(/\.$/, "");
  return reason ? { word: "reason.other", values: { what } } : null;
};
