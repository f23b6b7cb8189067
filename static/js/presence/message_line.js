/** A line of the conversation, on the drive page and on the robot's display. */

import { make } from "../lib/dom.js";

/** @param {{who: string, text: string, own: boolean}} line @returns {HTMLLIElement} */
export const lineOf = ({ who, text, own }) => {
  const line = make("li", own ? "line line--own" : "line");
  line.append(make("span", "line__who", who), " ", make("span", "line__text", text));
  return line;
};
