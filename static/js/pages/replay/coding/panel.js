/**
 * The panel by which somebody codes a replay: a button and a key for each code, the events so far,
 * and whether they are saved.
 */

import { isShortcut, openHolder } from "../../../input/key_dispatcher.js";
import { make, makeButton, write } from "../../../lib/dom.js";
import { written } from "../timeline.js";
import { createEditor } from "./editor.js";
import { newUuid } from "../../../lib/ids.js";
import { openOne, press, withEdits } from "./events.js";
import { SaveQueue } from "./save_queue.js";

/** @typedef {import("./events.js").Code} Code */
/** @typedef {import("./events.js").CodedEvent} CodedEvent */

const TYPED = "input:not([type=range], [type=checkbox]), textarea, select";

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
    this.queue = new SaveQueue({
      storage: storageOf(),
      key: config.kept,
      send: (edits) => this.#post(config.save, JSON.stringify({ edits }), "application/json"),
      onState: (state) => this.#showState(state),
      onAnswer: (answer, sent) => this.#takeAnswer(answer, sent),
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

  /** @param {import("./events.js").Edit[]} edits */
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

  /** Which states are on at a moment. @param {number} t s */
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

  /** A comment that is being typed is kept. @param {CodedEvent[]} events */
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
    write(
      element("coding-status"),
      words.say(this.isDone ? (this.isShown ? "coding.is_shown" : "coding.is_done") : "coding.own"),
    );
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
    const isPoint = code?.kind === "point";
    const end =
      event.end === null
        ? isPoint
          ? ""
          : ` – ${words.say("coding.open")}`
        : ` – ${written(event.end, true)}`;
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
    document.addEventListener("keydown", (event) => {
      const target = /** @type {Element} */ (event.target);
      if (event.repeat || isShortcut(event) || openHolder(document) || target.closest(TYPED)) {
        return;
      }
      const code = this.codes.find(
        ({ key }) => key && key.toLowerCase() === event.key.toLowerCase(),
      );
      if (code) {
        event.preventDefault();
        this.press(code);
      }
    });
  }

  async #finish() {
    if (!(await this.queue.settled())) {
      this.#say(this.words.say("coding.unsaved"));
      return;
    }
    const body = new URLSearchParams(this.isDone ? { again: "1" } : {});
    const { status, body: answer } = await this.#post(
      this.config.done,
      body,
      "application/x-www-form-urlencoded",
    ).catch(() => ({ status: 0, body: null }));
    if (status === 200 || status === 409) {
      this.#takeAnswer(answer, []);
    } else {
      this.#say(this.words.say("coding.no_answer"));
    }
  }

  /** @param {any} answer @param {import("./events.js").Edit[]} sent */
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

  /** What another tab has saved. */
  async #reload() {
    const answer = await fetch(this.config.events, { credentials: "same-origin" }).catch(
      () => null,
    );
    if (answer?.ok) {
      this.#takeAnswer(await answer.json(), []);
    }
    this.queue.flush();
  }

  /** @param {string} url @param {BodyInit} body @param {string} type */
  async #post(url, body, type) {
    const headers = { "X-CSRFToken": this.csrf, "Content-Type": type, Accept: "application/json" };
    const answer = await fetch(url, {
      method: "POST",
      body,
      headers,
      credentials: "same-origin",
      redirect: "manual",
    });
    const status = answer.type === "opaqueredirect" ? 302 : answer.status;
    return { status, body: await answer.json().catch(() => null) };
  }

  /** @param {import("./save_queue.js").SaveState} state */
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

/**
 * Bring a row into sight without moving the page, on which somebody watches the map.
 * @param {Element} list @param {Element} row
 */
const scrollInside = (list, row) => {
  const [box, own] = [list.getBoundingClientRect(), row.getBoundingClientRect()];
  list.scrollTop +=
    own.top < box.top
      ? own.top - box.top
      : Math.max(0, Math.min(own.bottom - box.bottom, own.top - box.top));
};

/**
 * Continue in the field of a new list what was being typed in that of the old one.
 * @param {HTMLInputElement | null} field @param {HTMLInputElement} former
 */
const keepTyping = (field, former) => {
  if (field && field.defaultValue !== former.value.trim()) {
    field.value = former.value;
    field.focus();
    field.setSelectionRange(former.selectionStart, former.selectionEnd);
  }
};

/** Storage may be forbidden. @returns {Storage | null} */
const storageOf = () => {
  try {
    return localStorage;
  } catch (error) {
    if (error instanceof DOMException) {
      return null;
    }
    throw error;
  }
};
