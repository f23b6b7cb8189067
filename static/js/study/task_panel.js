/**
 * Shows the task: its sentence, the checkpoints, the time left; on a small screen a line to open.
 */

import { clockTime } from "../lib/clock.js";
import { make, write } from "../lib/dom.js";
import { maySteer } from "../protocol/capabilities.js";
import { guideFor } from "./guide.js";

const OURS = ["keyboard", "stick"]; // the controllers of this page

/** @param {GetElement} element @param {Words} words @returns {(state: State) => void} */
export const createPanel = (element, words) => {
  const panel = element("task");
  const line = /** @type {HTMLButtonElement} */ (element("task-line"));
  const list = element("task-stops");
  let drawn = "";
  let mapSize = "";
  const small = matchMedia("(max-width: 999px), (max-height: 540px)");
  const fit = () => {
    line.disabled = !small.matches;
    line.setAttribute("aria-expanded", String(!small.matches || panel.hasAttribute("data-open")));
  };
  fit();
  small.addEventListener("change", fit);
  line.addEventListener("click", (event) => {
    panel.toggleAttribute("data-open");
    fit();
    if (event.detail > 0) {
      line.blur();
    }
  });

  return (state) => {
    const guide = guideFor(state);
    panel.hidden = guide === null;
    element("drive-page").toggleAttribute("data-guided", guide !== null);
    for (const method of OURS) {
      element("drive-page").toggleAttribute(`data-no-${method}`, !maySteer(state, method));
    }
    if (!guide) {
      return;
    }
    if (mapSize !== (mapSize = state.mapSize) && mapSize === "large") {
      panel.removeAttribute("data-open"); // the map needs the room
      fit();
    }
    panel.dataset.cue = guide.cue;
    write(element("task-cue"), sentence(guide, words));
    write(element("task-place"), guide.place);
    // the time left, once the study shows it; before that the time driven, if there are no dials
    element("task-time").toggleAttribute("data-driven", guide.left === null);
    write(element("task-time"), timeOf(guide, words));
    write(element("task-note"), noteOf(state, words));
    const key = JSON.stringify(guide.stops);
    if (key !== drawn) {
      drawn = key;
      list.replaceChildren(...guide.stops.map((stop) => stopItem(stop, words)));
    }
  };
};

/** @param {import("./guide.js").Guide} guide @param {Words} words */
const timeOf = ({ left, driven }, words) => {
  if (left !== null) {
    return words.say("reading.left", { time: clockTime(Math.ceil(left)) });
  }
  return driven === null ? "" : words.say("reading.driven", { time: clockTime(driven) });
};

/**
 * General for a newer server's cue.
 * @param {import("./guide.js").Guide} guide @param {Words} words
 */
export const sentence = ({ cue, number }, words) =>
  words.say(words.has(cue) ? cue : "cue.other", { number: number ?? "" });

/** The sentences about controllers that are off. @param {State} state @param {Words} words */
const noteOf = (state, words) =>
  OURS.filter((method) => !maySteer(state, method))
    .map((method) => words.say(`off.${method}`))
    .join(" ");

/** @param {import("./guide.js").Stop} stop @param {Words} words */
const stopItem = ({ number, title, status }, words) => {
  const item = make("li", "task__stop");
  item.dataset.status = status;
  item.title = title;
  const mark = status === "passed" ? "✓" : number === 0 ? "ϟ" : String(number);
  const sign = make("span", "", mark);
  sign.setAttribute("aria-hidden", "true");
  const word = `stop.${number === 0 ? "station" : "checkpoint"}.${status}`;
  item.append(sign, make("span", "visually-hidden", words.say(word, { number })));
  return item;
};
