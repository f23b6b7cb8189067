/**
 * Shows a card. It is no modal dialog: those would lie over the stop button and take its clicks.
 */

import { backToDriving, make, write } from "../../lib/dom.js";

export class CardPanel {
  /**
   * @param {object} options
   * @param {GetElement} options.element gives the page's elements: #card, with #card-title,
   *   #card-warning, #card-text, #card-instead, #card-main, #card-extra, #card-other and
   *   #card-count in it
   * @param {Words} options.words @param {(action: string) => void} options.onAction
   */
  constructor({ element, words, onAction }) {
    const part = (/** @type {string} */ id) => element(`card-${id}`);
    this.element = element("card");
    this.find = element;
    this.words = words;
    this.title = part("title");
    this.warning = part("warning");
    this.text = part("text");
    this.count = part("count");
    this.main = /** @type {HTMLButtonElement} */ (part("main"));
    this.extra = /** @type {HTMLButtonElement} */ (part("extra"));
    this.other = /** @type {HTMLButtonElement} */ (part("other"));
    this.instead = part("instead");
    this.offered = "";
    this.shown = "";
    this.instead.addEventListener("click", (event) => {
      const opensHere = !(event.ctrlKey || event.metaKey || event.shiftKey);
      if (opensHere && event.target instanceof HTMLAnchorElement) {
        onAction("leave_now"); // a driver of another robot leaves the queue of this one
      }
    });
    for (const button of [this.main, this.extra, this.other]) {
      button.addEventListener("click", () => onAction(button.dataset.action ?? ""));
    }
  }

  /** @param {Card | null} card */
  show(card) {
    if (!card && this.element.contains(document.activeElement)) {
      backToDriving(this.find); // also when the card disappears by itself
    }
    this.element.hidden = card === null;
    if (card === null) {
      this.shown = "";
      return;
    }
    const {
      word,
      values = {},
      detail = null,
      warning = null,
      busy = false,
      main,
      extra,
      other,
      instead = [],
      countdown,
      quiet = false,
    } = card;
    this.element.toggleAttribute("data-busy", busy);
    // one that asks nothing but for patience leaves the keys alone
    this.element.toggleAttribute("data-holds-keys", !busy);
    this.element.dataset.card = word;
    write(this.title, this.words.say(`${word}.title`, values));
    this.warning.hidden = warning === null;
    this.warning.dataset.word = warning?.word ?? "";
    write(this.warning, warning ? this.words.say(warning.word, warning.values) : "");
    write(this.text, textOf({ word, values, detail }, this.words));
    write(this.count, countdown === undefined ? "" : String(countdown));
    this.#button(this.main, main);
    this.#button(this.extra, extra);
    this.#button(this.other, other);
    this.#offer(instead);
    if (word !== this.shown) {
      const first = this.shown === "";
      this.shown = word;
      if (quiet) {
        this.title.focus({ preventScroll: true });
      } else if (!first || !busy) {
        this.#takeFocus();
      }
    }
  }

  /** @param {import("./card.js").FreeRobot[]} robots */
  #offer(robots) {
    const key = JSON.stringify(robots);
    if (key === this.offered) {
      return;
    }
    this.offered = key;
    this.instead.hidden = robots.length === 0;
    this.instead.replaceChildren(
      this.words.say("instead"),
      ...robots.map(({ action, url }) => {
        const link = make("a", "button", action);
        link.href = url;
        return link;
      }),
    );
  }

  /** @param {HTMLButtonElement} button @param {{action: string, word: string} | undefined} what */
  #button(button, what) {
    button.hidden = !what;
    button.dataset.action = what?.action ?? "";
    write(button, what ? this.words.say(what.word) : "");
  }

  /**
   * After a press on a button of the last card the focus is on this card's button, not on the
   * bare page.
   */
  #takeFocus() {
    const active = document.activeElement;
    const lost =
      active === null ||
      active === document.body ||
      (active instanceof HTMLElement && active.hidden) ||
      active === this.main ||
      active === this.extra ||
      active === this.other;
    if (lost) {
      const target =
        [this.main, this.extra, this.other].find((button) => !button.hidden) ?? this.title;
      target.focus({ preventScroll: true });
    }
  }
}

/** @param {Card} card @param {Words} words @returns {string} */
export const textOf = ({ word, values, detail }, words) =>
  [detail ? words.say(detail.word, detail.values) : "", words.say(`${word}.text`, values)]
    .filter(Boolean)
    .join(" ");
