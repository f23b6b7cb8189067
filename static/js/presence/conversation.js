/**
 * What visitor and people at the robot have written to each other, on the drive page: a list in
 * which every sentence of the visitor says how far it has come. Fetched when the chat is first
 * opened, or the people there write.
 */

import { unixNow } from "../lib/clock.js";
import { backToDriving, make, makeButton, write } from "../lib/dom.js";
import { lineFor, newDelivery, onAnswer, onReceipt, onTime, onWords, retry } from "./delivery.js";
import { lineOf } from "./message_line.js";

const MOST_LINES = 50;

export class Conversation {
  /** @param {Page} page */
  constructor(page) {
    this.page = page;
    this.list = page.element("talk-list");
    /**
     * @type {Map<string, {delivery: import("./delivery.js").Delivery, line: HTMLElement}>} the
     *   visitor's own, by the id of their `say`
     */
    this.own = new Map();
  }

  clear() {
    this.own.clear();
    this.list.replaceChildren();
  }

  /** The visitor's sentence leaves the page. @param {RobotAction} action */
  sent(action) {
    const line = lineOf({
      who: this.page.words.say("presence.you"),
      text: action.fields.text,
      own: true,
    });
    line.append(this.#stateOf(action.id));
    this.own.set(action.id, { delivery: newDelivery(action), line });
    this.#append(line, true);
    this.#render(action.id);
  }

  /**
   * @param {{by: string, who: string, text: string, actionId: string, receipts: boolean}} message
   */
  received(message) {
    const { by, who, text, actionId } = message;
    const { words } = this.page;
    if (this.own.has(actionId)) {
      this.#change(actionId, (delivery) => onWords(delivery, message, unixNow()));
    } else {
      const mine = by === "driver"; // written on this page before it was loaded anew
      this.#append(
        lineOf({
          who: mine ? words.say("presence.you") : words.nameOf(who) || words.say("presence.they"),
          text,
          own: mine,
        }),
        mine,
      );
    }
  }

  /** @param {any} status of an action, the visitor's sentences among them */
  answered(status) {
    this.#change(status.actionId, (delivery) => onAnswer(delivery, status, unixNow()));
  }

  /** @param {{actionId: string, state: "shown" | "not_spoken" | "spoken"}} receipt */
  confirmed({ actionId, state }) {
    this.#change(actionId, (delivery) => onReceipt(delivery, state, unixNow()));
  }

  /** @param {number} now */
  poll(now) {
    for (const [id, { delivery }] of this.own) {
      const { delivery: next, send } = onTime(delivery, now);
      this.#change(id, () => next);
      if (send) {
        this.page.driving.sendAction(next.action);
      }
    }
  }

  /**
   * @param {string} id
   * @param {(delivery: import("./delivery.js").Delivery) => import("./delivery.js").Delivery}
   *   change
   */
  #change(id, change) {
    const entry = this.own.get(id);
    if (entry) {
      entry.delivery = change(entry.delivery);
      this.#render(id);
    }
  }

  /**
   * How far a sentence has come, and a button for one that was not sent.
   * @param {string} id @returns {HTMLElement}
   */
  #stateOf(id) {
    const state = make("span", "line__state");
    const word = this.page.words.say("said.again");
    const again = makeButton("button presence__small line__again", word, () => {
      this.#change(id, (delivery) => retry(delivery, unixNow()));
      const entry = this.own.get(id);
      if (entry) {
        this.page.driving.sendAction(entry.delivery.action);
      }
      backToDriving(this.page.element);
    });
    state.append(make("span"), again);
    return state;
  }

  /** @param {string} id */
  #render(id) {
    const { delivery, line } =
      /** @type {{delivery: import("./delivery.js").Delivery, line: HTMLElement}} */ (
        this.own.get(id)
      );
    const state = /** @type {HTMLElement} */ (line.querySelector(".line__state"));
    if (state.dataset.stage !== delivery.stage) {
      state.dataset.stage = delivery.stage;
    }
    const [words, again] = /** @type {HTMLElement[]} */ (Array.from(state.children));
    again.hidden = delivery.stage !== "failed";
    write(
      words,
      this.page.words.say(lineFor(delivery, this.page.store.get().robot?.screens ?? 0, unixNow())),
    );
  }

  /** @param {HTMLElement} line @param {boolean} mine */
  #append(line, mine) {
    const {
      list,
      page: { store },
    } = this;
    list.append(line);
    while (list.children.length > MOST_LINES) {
      const first = list.firstElementChild;
      first?.remove();
      for (const [id, entry] of this.own) {
        if (entry.line === first) {
          this.own.delete(id);
        }
      }
    }
    const { panel, unread } = store.get();
    // What somebody says there is worth seeing at once; the keys go on driving, or stay with the
    // menu that has them.
    const next = mine ? panel : panel || "talk";
    store.update({ panel: next, unread: next === "talk" ? 0 : unread + (mine ? 0 : 1) });
    store.flush(); // what is hidden cannot be scrolled
    list.scrollTop = list.scrollHeight;
  }
}
