/** The editor of a coded event. */

import { make, makeButton } from "../../../lib/dom.js";
import { edited, moved } from "./events.js";

const NUDGE_S = 0.1;

/** @typedef {import("./events.js").Code} Code */
/** @typedef {import("./events.js").CodedEvent} CodedEvent */
/** @typedef {import("./events.js").Edit} Edit */

/**
 * @param {CodedEvent} event @param {Code} code @param {Words} words @param {object} page
 * @param {() => number} page.now s
 * @param {number} page.duration s
 * @param {() => string} page.newId @param {(edits: Edit[]) => void} page.change
 * @param {(t: number) => void} page.seek @param {(text: string) => void} page.say
 * @returns {HTMLElement}
 */
export const createEditor = (event, code, words, page) => {
  const box = make("div", "coding__editor");
  const sides = code.kind === "point" ? ["begin"] : ["begin", "end"];
  for (const side of sides) {
    box.append(sideRow(event, /** @type {"begin" | "end"} */ (side), words, page));
  }
  for (const modifier of code.modifiers) {
    box.append(modifierRow(event, modifier, words, page));
  }
  const remove = () => page.change([edited(event, { is_deleted: true }, page.newId)]);
  const name = "button button--danger coding__delete";
  box.append(commentRow(event, words, page), makeButton(name, words.say("coding.delete"), remove));
  return box;
};

/** A button of a row. @param {string} text @param {string} label @param {() => void} press */
const sideButton = (text, label, press) => {
  const button = makeButton("button button--plain", text, press);
  button.setAttribute("aria-label", label);
  return button;
};

/**
 * @param {CodedEvent} event @param {"begin" | "end"} side @param {Words} words @param {any} page
 */
const sideRow = (event, side, words, page) => {
  const row = make("div", "coding__side");
  const title = words.say(`coding.${side}`);
  const at = event[side];
  const put = (/** @type {number} */ t) => {
    const edit = moved(event, side, t, page.duration, page.newId);
    if (edit) {
      page.change([edit]);
      page.seek(t);
    } else {
      page.say(words.say("coding.order"));
    }
  };
  row.append(
    make("span", "coding__side-name", title),
    make("span", "coding__side-time numbers", at === null ? "–" : `${at.toFixed(2)} s`),
  );
  const here = words.say("coding.here");
  row.append(sideButton(here, `${title}: ${here}`, () => put(page.now())));
  for (const [sign, step] of /** @type {[string, number][]} */ ([
    ["−", -NUDGE_S],
    ["+", NUDGE_S],
  ])) {
    const label = `${title} ${sign} ${NUDGE_S} s`;
    const nudge = sideButton(sign, label, () => put((at ?? 0) + step));
    nudge.classList.add("coding__nudge");
    nudge.disabled = at === null;
    row.append(nudge);
  }
  return row;
};

/**
 * @param {CodedEvent} event @param {{name: string, values: string[]}} modifier @param {Words} words
 * @param {any} page
 */
const modifierRow = (event, modifier, words, page) => {
  const label = make("label", "coding__field", modifier.name);
  const select = make("select", "");
  for (const value of ["", ...modifier.values]) {
    select.append(new Option(value || words.say("coding.none"), value));
  }
  select.value = event.modifiers[modifier.name] ?? "";
  select.addEventListener("change", () => {
    const modifiers = { ...event.modifiers, [modifier.name]: select.value };
    if (!select.value) {
      delete modifiers[modifier.name];
    }
    page.change([edited(event, { modifiers }, page.newId)]);
  });
  label.append(select);
  return label;
};

/** @param {CodedEvent} event @param {Words} words @param {any} page */
const commentRow = (event, words, page) => {
  const label = make("label", "coding__field", words.say("coding.comment"));
  const input = make("input", "");
  Object.assign(input, { type: "text", maxLength: 500, defaultValue: event.comment });
  input.addEventListener("change", () =>
    page.change([edited(event, { comment: input.value.trim() }, page.newId)]),
  );
  label.append(input);
  return label;
};
