/**
 * The list in which a visitor chooses keys: for each command a button with its keys. Once pressed,
 * it takes the next key. While the panel is open no key drives: it holds the keys
 * (key_dispatcher.js), and the event of the chosen key stops here.
 */

import { rememberKeys } from "../lib/storage.js";
import { make, write } from "../lib/dom.js";
import { labelOf } from "./keymap.js";

/** @param {Page} page */
export const createOwnKeys = ({ element, words, keys: { keymap }, config, useKeys }) => {
  const section = element("own-keys");
  const buttons = /** @type {HTMLButtonElement[]} */ (
    Array.from(section.querySelectorAll("button[data-command]"))
  );
  const note = element("own-keys-note");
  /** @type {HTMLButtonElement | null} the one whose key is awaited */
  let asked = null;

  const ask = (
    /** @type {HTMLButtonElement | null} */ button,
    sentence = button ? words.say("keys.press") : "",
  ) => {
    asked = button;
    write(note, sentence);
    for (const one of buttons) {
      writeKeys(one, signsOf(keymap.keys[one.dataset.command ?? ""], words), one === asked);
    }
  };

  const choose = (/** @type {Record<string, string[]>} */ own) => {
    useKeys(own);
    rememberKeys(config.who ?? "", own);
    ask(null, words.say("keys.kept"));
  };

  const take = (/** @type {KeyboardEvent} */ { key, code }) => {
    const command = asked?.dataset.command ?? "";
    const why = keymap.refuses(command, code);
    if (key === "Escape") {
      ask(null);
    } else if (why) {
      ask(asked, words.say(`keys.${why}`));
    } else {
      choose(keymap.withKey(command, code));
    }
  };

  section.addEventListener("click", (/** @type {any} */ { target }) => {
    const button = buttons.find((one) => one.contains(target));
    if (button) {
      button.focus(); // Safari gives it to no button that is clicked
      ask(button === asked ? null : button);
    }
  });
  element("own-keys-usual").addEventListener("click", () => choose({}));
  section.addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => {
    if (!asked || event.ctrlKey || event.altKey || event.metaKey) {
      return;
    }
    event.preventDefault();
    event.stopPropagation();
    take(event);
  });
  section.addEventListener("focusout", (/** @type {any} */ { relatedTarget }) => {
    // nothing may move under a press on the next button
    if (asked && !section.contains(relatedTarget)) {
      ask(null);
    }
  });

  const show = (/** @type {boolean} */ shown) => {
    section.hidden = !shown;
    ask(null);
  };
  return { show };
};

/** The labels of a command's keys. @param {readonly string[]} own @param {Words} words */
const signsOf = (own, words) =>
  own.length ? own.map((key) => (key === "Space" ? words.say("keys.space") : labelOf(key))) : ["–"];

/**
 * Shows the keys of a command. Unchanged elements stay: otherwise a press on them is no click.
 * @param {HTMLElement} button @param {string[]} signs
 * @param {boolean} isAsked its next key is awaited
 */
const writeKeys = (button, signs, isAsked) => {
  const different = Array.from(new Set(signs));
  if (button.textContent !== different.join("")) {
    button.replaceChildren(...different.map((sign) => make("kbd", "", sign)));
  }
  button.setAttribute("aria-pressed", String(isAsked));
};
