/**
 * The page of a questionnaire: saves each answer at once, shows questions that depend on answers,
 * and measures attention. Without this script the form is sent as a whole.
 */

import { make } from "../../lib/dom.js";
import { freshId } from "../../lib/ids.js";
import { SaveQueue } from "../../lib/save_queue.js";
import { createAttention } from "./attention.js";
import { shownKeys } from "./conditions.js";
import { keepOrder } from "./ranking.js";
import { addRange } from "./slider.js";

const SEND_LIMIT_MS = 10000;
const SIGNED_OUT = 403;

const form = /** @type {HTMLFormElement} */ (document.getElementById("survey"));
const status = /** @type {HTMLElement} */ (form.querySelector("[data-status]"));
/** @param {string} selector @returns {HTMLElement[]} */
const all = (selector) =>
  [...form.querySelectorAll(selector)].map((one) => /** @type {any} */ (one));
const questions = /** @type {HTMLFieldSetElement[]} */ (all("[data-question]"));
const byKey = new Map(questions.map((question) => [question.dataset.question ?? "", question]));
const attention = createAttention(() => performance.now() / 1000);
const writer = freshId();
let writing = 0;

/**
 * @param {HTMLFieldSetElement} question
 * @returns {[string, string][]} what its controls would send
 */
const fieldsOf = (question) =>
  controlsOf(question)
    .filter((control) => !["radio", "checkbox"].includes(control.type) || control.checked)
    .map((control) => [control.name, control.value]);

/** @param {HTMLFieldSetElement} question */
const controlsOf = (question) =>
  /** @type {HTMLInputElement[]} */ ([
    ...question.querySelectorAll("input[name], select, textarea"),
  ]).filter((control) => control.name !== "shown");

/** @param {string} key */
const said = (key) => {
  const question = byKey.get(key);
  return question
    ? fieldsOf(question)
        .filter(([name]) => name === key)
        .map(([, value]) => value)
    : [];
};

// --- questions -----------------------------------------------------------------------------------

const conditions = questions.map((question) => ({
  key: question.dataset.question ?? "",
  condition: question.dataset.showIf ? JSON.parse(question.dataset.showIf) : null,
}));

const refresh = () => {
  const shown = shownKeys(conditions, said);
  for (const [key, question] of byKey) {
    question.hidden = question.disabled = !shown.has(key);
    const clear = /** @type {HTMLElement | null} */ (question.querySelector("[data-clear]"));
    if (clear) clear.hidden = fieldsOf(question).every(([, value]) => value === "");
  }
  for (const block of all("[data-block]")) {
    block.hidden = !block.querySelector("[data-question]:not([hidden])");
  }
};

/** @param {string} key @param {string} error */
const showError = (key, error) => {
  const line = make("p", "field__error");
  line.append(make("span", "", error));
  byKey
    .get(key)
    ?.querySelector("[data-error]")
    ?.replaceChildren(...(error ? [line] : []));
};

// --- saving --------------------------------------------------------------------------------------

/**
 * @typedef {{id: string, key: string, fields: [string, string][]}} Change
 * @param {Change[]} changes one
 * @returns {Promise<import("../../lib/save_queue.js").Outcome>}
 */
const send = async ([{ key, fields }]) => {
  writing += 1;
  const seconds = attention.of(key);
  const body = new URLSearchParams([
    ...fields,
    ["item", key],
    ["writer", writer],
    ["writing", String(writing)],
    ["seconds", seconds === undefined ? "" : JSON.stringify({ [key]: seconds })],
    [
      "csrfmiddlewaretoken",
      /** @type {HTMLInputElement} */ (form.elements.namedItem("csrfmiddlewaretoken")).value,
    ],
  ]);
  try {
    const answer = await fetch(form.dataset.answer ?? "", {
      method: "POST",
      body,
      signal: AbortSignal.timeout(SEND_LIMIT_MS),
    });
    if (answer.ok) return { state: "saved", isDone: true };
    if (answer.status >= 500) return { state: "waiting" };
    const isJson = answer.headers.get("content-type")?.startsWith("application/json");
    const refusal = { error: form.dataset.button ?? "", ...(isJson && (await answer.json())) };
    return { state: "refused", isDone: answer.status !== SIGNED_OUT, body: refusal };
  } catch {
    return { state: "waiting" };
  }
};

// The other pages of the questionnaire were sent when the participant came to this one.
const [SURVEY, PAGE] = [location.pathname.replace(/[^/]*\/$/, ""), location.pathname];
for (const name of Object.keys(sessionStorage)) {
  if (name.startsWith(`survey:${SURVEY}`) && !name.startsWith(`survey:${PAGE}:`))
    sessionStorage.removeItem(name);
}

/** @type {SaveQueue<Change>} */
const queue = new SaveQueue({
  storage: sessionStorage,
  key: `survey:${PAGE}`,
  most: 1,
  replaces: (old, { key }) => old.key === key,
  send,
  onState: (state, [{ key }], outcome) => {
    const error = outcome?.body?.error ?? "";
    status.dataset.state = state;
    status.textContent = `${form.dataset[state] ?? ""} ${error}`.trim();
    if (state === "saved" || state === "refused") showError(key, error);
  },
});

/** @param {HTMLFieldSetElement} question */
const changed = (question) => {
  const key = question.dataset.question ?? "";
  attention.touch(key);
  refresh();
  queue.add([{ id: freshId(), key, fields: fieldsOf(question) }]);
};

// --- listeners -----------------------------------------------------------------------------------

/** @param {Event} event */
const questionOf = ({ target }) => /** @type {any} */ (target).closest("[data-question]");

/**
 * Unticks the others when an option excludes them.
 * @param {HTMLInputElement} control @param {HTMLFieldSetElement} question
 */
const exclude = (control, question) => {
  const alone = (/** @type {HTMLInputElement} */ one) =>
    one.hasAttribute("data-reason") || one.hasAttribute("data-alone");
  const isTicked = control.type === "checkbox" ? control.checked : control.value !== "";
  if (control.type === "radio" || !isTicked) return;
  for (const other of controlsOf(question)) {
    if (other === control || (!alone(control) && !alone(other))) continue;
    empty(other);
  }
};

/** @param {HTMLInputElement} control */
const empty = (control) => {
  if (["radio", "checkbox"].includes(control.type)) control.checked = false;
  else control.value = "";
  control.dispatchEvent(new Event("survey:restored"));
};

/**
 * Chooses the value that a list offers: several lists of one name offer different ones.
 * @param {HTMLSelectElement} list @param {string[]} values
 */
const choose = (list, values) => {
  const offered = [...list.options].map(({ value }) => value);
  list.value = values.find((value) => value !== "" && offered.includes(value)) ?? "";
};

form.addEventListener("change", (event) => {
  const question = questionOf(event);
  if (!question) return;
  exclude(/** @type {HTMLInputElement} */ (event.target), question);
  changed(question);
});

form.addEventListener("click", (event) => {
  if (!(/** @type {Element} */ (event.target).closest("[data-clear]"))) return;
  const question = questionOf(event);
  if (!question) return;
  for (const control of controlsOf(question)) empty(control);
  changed(question);
  controlsOf(question)[0].focus();
});

form.addEventListener("submit", (event) => {
  if (navigator.onLine === false) {
    // The browser would show its own error page; here the answers stay visible and stored.
    event.preventDefault();
    status.dataset.state = "waiting";
    status.textContent = form.dataset.waiting ?? "";
    return;
  }
  writing += 1;
  /** @type {[string, string][]} */
  const about = [
    ["seconds", JSON.stringify(attention.all())],
    ["writer", writer],
    ["writing", String(writing)],
  ];
  for (const [name, value] of about)
    /** @type {HTMLInputElement} */ (form.elements.namedItem(name)).value = value;
});

window.addEventListener("online", () => queue.flush());
document.addEventListener("visibilitychange", () =>
  attention.setSeen(document.visibilityState === "visible"),
);

// --- start ---------------------------------------------------------------------------------------

all("[data-slider]").forEach(addRange);
all("[data-ranking]").forEach(keepOrder);
for (const { key, fields } of queue.pending) {
  const question = byKey.get(key);
  if (!question) continue;
  for (const control of controlsOf(question)) {
    const values = fields.filter(([name]) => name === control.name).map(([, value]) => value);
    if (["radio", "checkbox"].includes(control.type))
      control.checked = values.includes(control.value);
    else if (control instanceof HTMLSelectElement) choose(control, values);
    else control.value = values[0] ?? "";
    control.dispatchEvent(new Event("survey:restored"));
  }
}
refresh();
queue.flush();
