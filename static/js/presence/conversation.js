/**
 * The messages between the visitor and the people at the robot, with the delivery state of the
 * visitor's own. Fetched when the chat is first opened, or a message arrives.
 */

import { unixNow } from "../lib/clock.js";
import { backToDriving, make, makeButton, write } from "../lib/dom.js";
import { lineFor, newDelivery, onAnswer, onReceipt, onTime, onWords, retry } from "./delivery.js";
import { lineOf } from "./message_line.js";

const MOST_LINES = 50;

/** @typedef {import("./delivery.js").Delivery} Delivery */

export class Conversation {
  /** @param {Page} page */
  constructor(page) {
    this.page = page;
    this.list = page.element("talk-list");
    /** @type {Map<string, {delivery: Delivery, line: HTMLElement}>} own messages by their id */
    this.own = new Map();
  }

  clear() {
    this.own.clear();
    this.list.replaceChildren();
  }

  /** @param {RobotAction} action */
  sent(action) {
    const who = this.page.words.say("presence.you");
    const line = lineOf({ who, text: action.fields.text, own: true });
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
      const own = by === "driver"; // written on this page before a reload
      const other = words.nameOf(who) || words.say("presence.they");
      this.#append(lineOf({ who: own ? words.say("presence.you") : other, text, own }), own);
    }
  }

  /** @param {any} status of an action, which may be a message */
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

  /** @param {string} id @param {(delivery: Delivery) => Delivery} change */
  #change(id, change) {
    const entry = this.own.get(id);
    if (entry) {
      entry.delivery = change(entry.delivery);
      this.#render(id);
    }
  }

  /**
   * The delivery state of a message, with a button to send it again.
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
    const { delivery, line } = /** @type {any} */ (this.own.get(id));
    const state = line.querySelector(".line__state");
    if (state.dataset.stage !== delivery.stage) {
      state.dataset.stage = delivery.stage;
    }
    const [words, again] = state.children;
    again.hidden = delivery.stage !== "failed";
    const screens = this.page.store.get().robot?.screens ?? 0;
    write(words, this.page.words.say(lineFor(delivery, screens, unixNow())));
  }

  /** @param {HTMLElement} line @param {boolean} mine */
  #append(line, mine) {
    const { list } = this;
    const { store } = this.page;
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
    // A message from the robot's side opens the panel, unless another one is open.
    const next = mine ? panel : panel || "talk";
    store.update({ panel: next, unread: next === "talk" ? 0 : unread + (mine ? 0 : 1) });
    store.flush(); // a hidden list cannot be scrolled
    list.scrollTop = list.scrollHeight;
  }
}
