/** The page that checks browser and network: a summary, and a line for each topic. */

import { element, readConfig } from "../../lib/dom.js";
import { find } from "../../lib/page_poll.js";
import { readWords } from "../../lib/words.js";
import { copy } from "../../lib/clipboard.js";
import { browserFor } from "./in_app.js";
import { probe } from "./probe.js";
import { judge, overall } from "./verdict.js";

const [config, words] = [readConfig(), readWords()];
const [section, again, link] = [element("check"), element("check-again"), element("check-copy")];

/** @param {import("./verdict.js").Line} line */
const draw = ({ topic, mark, word, values }) => {
  const row = element("check-row").content.cloneNode(true);
  const part = (/** @type {string} */ name) => find(`[data-${name}]`, row);
  part("mark").dataset.mark = mark;
  part("mark-text").textContent = words.say(`check.mark.${mark}`);
  part("topic").textContent = words.say(`check.topic.${topic}`);
  part("text").textContent = words.say(word, values);
  return row;
};

const run = async () => {
  section.dataset.state = "busy";
  again.disabled = true;
  element("check-title").textContent = words.say("check.overall.busy");
  const found = await probe(config);
  const lines = judge(found, config.iceServers);
  section.dataset.state = overall(lines);
  element("check-title").textContent = words.say(`check.overall.${overall(lines)}`);
  element("check-lines").replaceChildren(...lines.map(draw));
  link.hidden = found.live || !found.app;
  link.textContent = words.say("check.copy", { browser: browserFor(navigator.userAgent) });
  again.disabled = false;
};

again.addEventListener("click", () => void run());
link.addEventListener("click", async () => {
  if (await copy(new URL("/", location.href).href)) {
    link.textContent = words.say("check.copied");
  }
});
void run();
