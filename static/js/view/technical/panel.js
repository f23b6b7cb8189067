/** Shows the figures of the connection, twice a second, and copies them as text. */

import { copy } from "../../lib/clipboard.js";
import { backToDriving, make, write } from "../../lib/dom.js";
import { Figures } from "./figures.js";

const PERIOD_MS = 500;
const COPIED_MS = 2000;

/**
 * @param {object} page @param {GetElement} page.element @param {Words} page.words
 * @param {() => import("./figures.js").Raw} page.raw @returns {(shown: boolean) => void}
 */
export const createTechnical = ({ element, words, raw }) => {
  const panel = element("technical");
  const figures = new Figures(
    (way) => words.say(`figure.way.${way}`),
    document.documentElement.lang,
  );
  /** @type {Map<string, HTMLElement>} */
  const values = new Map();
  /** @type {import("./figures.js").Figure[]} */
  let last = [];
  /** @type {ReturnType<typeof setInterval> | undefined} */
  let timer;

  /** @param {import("./figures.js").Figure} figure */
  const place = ({ key, unit }) => {
    const [cell, value, text] = [make("div", "figure"), make("dd"), make("span")];
    cell.dataset.figure = key;
    value.append(text, unit && ` ${unit}`);
    cell.append(make("dt", "", words.say(`figure.${key}`)), value);
    values.set(key, text);
    return cell;
  };

  const show = async () => {
    const now = raw();
    const report = now.connection ? [...(await now.connection.getStats()).values()] : null;
    last = figures.read(now, report);
    if (values.size === 0) {
      element("figures").append(...last.map(place));
    }
    last.forEach(({ key, value }) => write(/** @type {HTMLElement} */ (values.get(key)), value));
  };

  element("figures-copy").addEventListener("click", async () => {
    const lines = last.map(({ key, value, unit }) =>
      `${words.say(`figure.${key}`)}: ${value} ${unit}`.trim(),
    );
    const copied = await copy(
      [document.title, new Date().toISOString(), navigator.userAgent, ...lines].join("\n"),
    );
    const text = element("figures-copy-text");
    write(text, words.say(copied ? "do.copied" : "do.copy_failed"));
    setTimeout(() => write(text, words.say("do.copy")), COPIED_MS);
    backToDriving(element);
  });

  return (shown) => {
    panel.hidden = !shown;
    element("drive-page").toggleAttribute("data-figures", shown);
    clearInterval(timer);
    if (shown) {
      void show();
      timer = setInterval(() => void show(), PERIOD_MS);
    }
  };
};
