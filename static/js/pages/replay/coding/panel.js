/** The panel for coding a replay: a button and a key for each code, and the coded events. */

import { onPageKey } from "../../../input/key_dispatcher.js";
import { make, makeButton, write } from "../../../lib/dom.js";
import { SaveQueue } from "../../../lib/save_queue.js";
import { attempt } from "../../../lib/storage.js";
import { fetchJson } from "../../../lib/page_poll.js";
import { written } from "../timeline.js";
import { createEditor } from "./editor.js";
import { newUuid } from "../../../lib/ids.js";
import { openOne, press, withEdits } from "./events.js";

/** @typedef {import("./events.js").Code} Code */
/** @typedef {import("./events.js").CodedEvent} CodedEvent */
/** @typedef {import("./events.js").Edit} Edit */

export class CodingPanel {
  /**
   * @param {(id: string) => any} element @param {any} config @param {Words} words
   * @param {{now: () => number, seek: (t: number) => void, duration: number}} player
   */
  constructor(element, config, words, player) {
    this.element = element;
    this.config = config;
    this.words = words;
    this.player = player;
    this.drawn = "";
    this.isDrawing = false;
    /** @type {Code[]} */
    this.codes = config.codes;
    /** @type {CodedEvent[]} what the server has */
    this.saved = config.saved;
    this.isDone = config.isDone;
    this.isShown = config.isShown;
    this.selected = "";
    this.csrf = element("coding").querySelector("[name=csrfmiddlewaretoken]").value;
    this.tabs = "BroadcastChannel" in window ? new BroadcastChannel(config.kept) : null;
    /** @type {SaveQueue<Edit>} */
    this.queue = new SaveQueue({
      storage: attempt(() => localStorage) ?? null,
      key: config.kept,
      send: async (edits) => {
        const body = JSON.stringify({ edits });
        return outcomeOf(await this.#post(config.save, body, "application/json"));
      },
      onState: (state, edits, outcome) => {
        if (outcome?.isDone || state === "refused") {
          this.#takeAnswer(outcome?.body ?? {}, outcome?.isDone ? edits : []);
        }
        this.#showState(state);
      },
    });
    this.buttons = new Map(this.codes.map((code) => [code.code, this.#button(code)]));
    element("coding-codes").replaceChildren(...this.buttons.values());
    this.#listen();
    this.render();
    this.#showState(this.queue.pending.length ? "saving" : "saved");
    this.queue.flush();
  }

  /** @returns {CodedEvent[]} */
  get events() {
    return withEdits(this.saved, this.queue.pending);
  }

  /** @param {Edit[]} edits */
  change(edits) {
    if (edits.length && !this.isDone && !this.isDrawing) {
      this.#say("");
      this.queue.add(edits);
      this.render();
    }
  }

  /** @param {Code} code */
  press(code) {
    if (this.isDone) {
      return;
    }
    const { edits, problem } = press(this.events, this.codes, code, this.player.now(), newUuid);
    this.change(edits);
    this.#say(problem ? this.words.say(`coding.${problem}`, { code: code.name }) : "");
    if (edits.length) {
      this.#select(edits[edits.length - 1].event);
    }
  }

  /** Marks the states that are on. @param {number} t s */
  mark(t) {
    const on = new Set(
      this.shown
        ?.filter(({ begin, end }) => begin <= t && (end === null || end > t))
        .map(({ code }) => code),
    );
    for (const code of this.codes.filter(({ kind }) => kind === "interval")) {
      this.buttons.get(code.code)?.classList.toggle("coding__code--on", on.has(code.code));
    }
  }

  render() {
    const events = this.events;
    this.shown = events;
    for (const code of this.codes) {
      const button = this.buttons.get(code.code);
      button.disabled = this.isDone;
      if (code.kind === "interval") {
        button.setAttribute("aria-pressed", String(Boolean(openOne(events, code.code))));
      }
    }
    this.#renderList(events);
    this.#renderDone();
    this.mark(this.player.now());
  }

  /** Keeps a comment that is being typed. @param {CodedEvent[]} events */
  #renderList(events) {
    const text = JSON.stringify([events, this.selected, this.isDone]);
    if (text === this.drawn) {
      return;
    }
    this.drawn = text;
    const list = this.element("coding-events");
    const field = /** @type {HTMLInputElement | null} */ (list.querySelector(":focus"));
    const focus = field?.getAttribute("aria-label");
    this.isDrawing = true; // the removal of a changed field is a change in Chromium
    list.replaceChildren(...events.map((event) => this.#row(event)));
    this.isDrawing = false;
    if (focus) {
      list.querySelector(`[aria-label="${CSS.escape(focus)}"]`)?.focus();
    } else if (field?.type === "text" && field.value !== field.defaultValue) {
      keepTyping(list.querySelector("input[type=text]"), field);
    }
    write(this.element("coding-count"), String(events.length));
  }

  #renderDone() {
    const { element, words } = this;
    element("coding").dataset.done = String(this.isDone);
    write(element("coding-done"), words.say(this.isDone ? "coding.reopen" : "coding.finish"));
    element("coding-done").hidden = this.isDone && this.isShown;
    const done = this.isShown ? "coding.is_shown" : "coding.is_done";
    write(element("coding-status"), words.say(this.isDone ? done : "coding.own"));
  }

  /** @param {Code} code */
  #button(code) {
    const button = makeButton("coding__code", "", () => this.press(code));
    button.title = code.description;
    button.append(make("span", "coding__name", code.name));
    if (code.key) {
      button.append(make("kbd", "coding__key", code.key));
      button.setAttribute("aria-keyshortcuts", code.key);
    }
    return button;
  }

  /** @param {CodedEvent} event */
  #row(event) {
    const { words } = this;
    const code = this.codes.find((one) => one.code === event.code);
    const row = make("li", "coding__event");
    const open = code?.kind === "point" ? "" : ` – ${words.say("coding.open")}`;
    const end = event.end === null ? open : ` – ${written(event.end, true)}`;
    const more = [...Object.values(event.modifiers), event.comment].filter(Boolean).join(" · ");
    const button = makeButton("coding__row", "", () => {
      this.#select(event.event === this.selected ? "" : event.event);
      this.player.seek(event.begin);
    });
    button.setAttribute("aria-expanded", String(event.event === this.selected));
    button.append(
      make("span", "coding__when numbers", `${written(event.begin, true)}${end}`),
      make("span", "coding__what", code?.name ?? event.code),
    );
    if (more) {
      button.append(make("span", "coding__more", more));
    }
    row.append(button);
    if (event.event === this.selected && code && !this.isDone) {
      const change = (/** @type {any} */ edits) => this.change(edits);
      const say = (/** @type {string} */ text) => this.#say(text);
      row.append(createEditor(event, code, words, { ...this.player, newId: newUuid, change, say }));
    }
    return row;
  }

  /** @param {string} event */
  #select(event) {
    this.selected = event;
    this.#renderList(this.events);
    const list = this.element("coding-events");
    const row = list.querySelector("[aria-expanded=true]")?.parentElement;
    if (row) {
      scrollInside(list, row);
    }
  }

  #listen() {
    const { element, queue } = this;
    element("coding-done").addEventListener("click", () => this.#finish());
    addEventListener("online", () => queue.flush());
    document.addEventListener(
      "visibilitychange",
      () => document.visibilityState === "visible" && this.#reload(),
    );
    this.tabs?.addEventListener("message", () => this.#reload());
    onPageKey(({ repeat, key: pressed }) => {
      const code = this.codes.find(({ key }) => key?.toLowerCase() === pressed.toLowerCase());
      if (code && !repeat) {
        this.press(code);
      }
      return code !== undefined && !repeat;
    });
  }

  async #finish() {
    if (!(await this.queue.settled())) {
      this.#say(this.words.say("coding.unsaved"));
      return;
    }
    const body = new URLSearchParams(this.isDone ? { again: "1" } : {});
    const type = "application/x-www-form-urlencoded";
    const { status, body: answer } = await this.#post(this.config.done, body, type);
    if (status === 200 || status === 409) {
      this.#takeAnswer(answer, []);
    } else {
      this.#say(this.words.say("coding.no_answer"));
    }
  }

  /** @param {any} answer @param {Edit[]} sent */
  #takeAnswer(answer, sent) {
    if (Array.isArray(answer?.saved)) {
      this.saved = answer.saved;
      this.isDone = answer.isDone;
      this.isShown = answer.isShown;
    }
    const refused = Object.values(answer?.refused ?? {});
    if (answer?.problem || refused.length) {
      this.#say([answer.problem, ...refused].filter(Boolean).join(" "));
    } else if (answer?.conflicts?.length) {
      this.#say(this.words.say("coding.conflict"));
    }
    this.render();
    if (sent.length) {
      this.tabs?.postMessage("saved");
    }
  }

  /** Takes the changes of another tab. */
  async #reload() {
    await fetchJson(this.config.events).then(
      (answer) => this.#takeAnswer(answer, []),
      () => undefined, // without network the events stay as they are
    );
    this.queue.flush();
  }

  /**
   * @param {string} url @param {BodyInit} body @param {string} type
   * @returns {Promise<{status: number, body: any}>} status 0 without network, 302 when signed out
   */
  async #post(url, body, type) {
    const headers = { "X-CSRFToken": this.csrf, "Content-Type": type, Accept: "application/json" };
    try {
      const answer = await fetch(url, { method: "POST", body, headers, redirect: "manual" });
      const status = answer.type === "opaqueredirect" ? 302 : answer.status;
      return { status, body: await answer.json().catch(() => null) };
    } catch {
      return { status: 0, body: null };
    }
  }

  /** @param {import("../../../lib/save_queue.js").SaveState} state */
  #showState(state) {
    const box = this.element("coding-saved");
    box.dataset.state = state;
    write(box, this.words.say(`coding.state.${state}`));
  }

  /** @param {string} text */
  #say(text) {
    const box = this.element("coding-message");
    write(box, text);
    box.hidden = !text;
  }
}

/** @type {Record<number, import("../../../lib/save_queue.js").SaveState>} */
const STATES = { 200: "saved", 400: "refused", 409: "refused" };
const SIGNED_OUT = [302, 401, 403, 404];

/**
 * @param {{status: number, body: any}} answer
 * @returns {import("../../../lib/save_queue.js").Outcome}
 */
export const outcomeOf = ({ status, body }) => {
  const other = SIGNED_OUT.includes(status) ? "signed_out" : "waiting";
  return { state: STATES[status] ?? other, isDone: status === 200, body };
};

/** Scrolls the list to a row, and not the page. @param {Element} list @param {Element} row */
const scrollInside = (list, row) => {
  const [box, own] = [list.getBoundingClientRect(), row.getBoundingClientRect()];
  list.scrollTop +=
    own.top < box.top
      ? own.top - box.top
      : Math.max(0, Math.min(own.bottom - box.bottom, own.top - box.top));
};

/**
 * Continues in a new field what was being typed in the former one.
 * @param {HTMLInputElement | null} field @param {HTMLInputElement} former
 */
const keepTyping = (field, former) => {
  if (field && field.defaultValue !== former.value.trim()) {
    field.value = former.value;
    field.focus();
    field.setSelectionRange(former.selectionStart, former.selectionEnd);
  }
};
