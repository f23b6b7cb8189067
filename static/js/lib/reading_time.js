/** How long a sentence is shown, so that a visitor who looks elsewhere can read it. */

import { unixNow } from "./clock.js";

const NOTICED = 4; // s
const WORD = 0.4; // s a word, for slow readers

/**
 * A sentence of the page that is shown from now on.
 * @param {Words} words @param {string} word @param {Record<string, string>} [values]
 */
export const toRead = (words, word, values = {}) => {
  const at = unixNow();
  const length = words.say(word, values).split(" ").length;
  return { word, values, at, until: at + NOTICED + WORD * length };
};
