/** Shows a card. It is no modal dialog, which would cover the stop button. */

import { backToDriving, make, showButton, write } from "../../lib/dom.js";

export class CardPanel {
  /**
   * @param {object} options
   * @param {GetElement} options.element
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
    this.buttons = [part("main"), part("extra"), part("other")];
    this.instead = part("instead");
    this.offered = "";
    this.shown = "";
    this.instead.addEventListener("click", (event) => {
      const opensHere = !(event.ctrlKey || event.metaKey || event.shiftKey);
      if (opensHere && event.target instanceof HTMLAnchorElement) {
        onAction("leave_now"); // to drive another robot, the visitor leaves this queue
      }
    });
    for (const button of this.buttons) {
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
    const { word, values = {}, warning = null, busy = false, countdown, quiet } = card;
    this.element.toggleAttribute("data-busy", busy);
    // a card without a question does not take the keys
    this.element.toggleAttribute("data-holds-keys", !busy);
    this.element.dataset.card = word;
    write(this.title, this.words.say(`${word}.title`, values));
    this.warning.hidden = warning === null;
    this.warning.dataset.word = warning?.word ?? "";
    write(this.warning, warning ? this.words.say(warning.word, warning.values) : "");
    write(this.text, textOf(card, this.words));
    write(this.count, countdown === undefined ? "" : String(countdown));
    [card.main, card.extra, card.other].forEach((button, i) => {
      showButton(this.buttons[i], button, this.words);
    });
    this.#offer(card.instead ?? []);
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

  /** Focuses a button of this card, if the focus is on the page or was on the card before. */
  #takeFocus() {
    const active = /** @type {HTMLElement | null} */ (document.activeElement);
    if (!active || active === document.body || active.hidden || this.buttons.includes(active)) {
      const target = this.buttons.find((button) => !button.hidden) ?? this.title;
      target.focus({ preventScroll: true });
    }
  }
}

/** @param {Card} card @param {Words} words @returns {string} */
export const textOf = ({ word, values, detail }, words) =>
  [detail ? words.say(detail.word, detail.values) : "", words.say(`${word}.text`, values)]
    .filter(Boolean)
    .join(" ");
