/**
 * The page of a questionnaire: saves each answer when it is given, shows what answers bring up,
 * measures attention. Without this module the same form is sent as a whole, and the server does the
 * rest.
 */

import { freshId } from "../../lib/ids.js";
import { createAttention } from "./attention.js";
import { shownKeys } from "./conditions.js";
import { createSaver } from "./saver.js";
import { keepOrder } from "./ranking.js";
import { addRange } from "./slider.js";

const SEND_LIMIT_MS = 10000;
const SIGNED_OUT = 403;

const form = /** @type {HTMLFormElement} */ (document.getElementById("survey"));
const status = /** @type {HTMLElement} */ (form.querySelector("[data-status]"));
const questions = /** @type {HTMLFieldSetElement[]} */ ([
  ...form.querySelectorAll("[data-question]"),
]);
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

// --- what is shown -------------------------------------------------------------------------------

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
  for (const block of /** @type {NodeListOf<HTMLElement>} */ (
    form.querySelectorAll("[data-block]")
  )) {
    block.hidden = ![...block.querySelectorAll("[data-question]")].some(
      (question) => !(/** @type {HTMLElement} */ (question).hidden),
    );
  }
};

/** @param {string} key @param {string} error */
const showError = (key, error) => {
  const place = byKey.get(key)?.querySelector("[data-error]");
  if (!place) return;
  place.replaceChildren();
  if (!error) return;
  const line = document.createElement("p");
  line.className = "field__error";
  line.append(Object.assign(document.createElement("span"), { textContent: error }));
  place.append(line);
};

// --- saving --------------------------------------------------------------------------------------

/** @param {string} key @param {[string, string][]} fields */
const send = async (key, fields) => {
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
    if (answer.status >= 500) return { ok: false, final: false };
    const told = answer.headers.get("content-type")?.startsWith("application/json")
      ? await answer.json()
      : {};
    return {
      ok: answer.ok,
      final: true,
      keep: answer.status === SIGNED_OUT,
      error: answer.ok ? "" : (told.error ?? form.dataset.button ?? ""),
    };
  } catch {
    return { ok: false, final: false };
  }
};

// Whoever came to another page has sent this one: what was kept of the others is no longer news.
const STORED = `survey:${location.pathname.replace(/[^/]*\/$/, "")}`;
for (const name of Object.keys(sessionStorage)) {
  if (name.startsWith(STORED) && name !== `survey:${location.pathname}`)
    sessionStorage.removeItem(name);
}

const saver = createSaver({
  send,
  tell: (state, key, error) => {
    status.dataset.state = state;
    status.textContent =
      {
        saving: form.dataset.saving,
        saved: form.dataset.saved,
        waiting: form.dataset.waiting,
        refused: `${form.dataset.refused} ${error}`,
        idle: "",
      }[state] ?? "";
    if (state === "saved" || state === "refused") showError(key, error);
  },
  storage: sessionStorage,
  name: `survey:${location.pathname}`,
  later: (run, ms) => setTimeout(run, ms),
});

/** @param {HTMLFieldSetElement} question */
const changed = (question) => {
  const key = question.dataset.question ?? "";
  attention.touch(key);
  refresh();
  void saver.save(key, fieldsOf(question));
};

// --- listeners -----------------------------------------------------------------------------------

/** @param {Event} event */
const questionOf = (event) =>
  /** @type {HTMLFieldSetElement | null} */ (
    /** @type {Element} */ (event.target).closest("[data-question]")
  );

/**
 * Tick what excludes others, untick the others.
 * @param {HTMLInputElement} control @param {HTMLFieldSetElement} question
 */
const exclude = (control, question) => {
  const alone = (/** @type {HTMLInputElement} */ one) =>
    one.hasAttribute("data-reason") || one.hasAttribute("data-alone");
  const ticked =
    control.type === "radio"
      ? false
      : control.type === "checkbox"
        ? control.checked
        : control.value !== "";
  if (!ticked) return;
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
 * Choose the value that a list offers: several lists of one name offer different ones.
 * @param {HTMLSelectElement} list @param {string[]} values
 */
const choose = (list, values) => {
  list.value =
    values.find(
      (value) => value !== "" && [...list.options].some((option) => option.value === value),
    ) ?? "";
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
    // The browser would show its own page of despair; here the answers stay in sight, and kept.
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

window.addEventListener("online", () => void saver.resume());
document.addEventListener("visibilitychange", () =>
  attention.setSeen(document.visibilityState === "visible"),
);

// --- start ---------------------------------------------------------------------------------------

for (const holder of /** @type {NodeListOf<HTMLElement>} */ (
  form.querySelectorAll("[data-slider]")
))
  addRange(holder);
for (const holder of /** @type {NodeListOf<HTMLElement>} */ (
  form.querySelectorAll("[data-ranking]")
))
  keepOrder(holder);
for (const [key, fields] of saver.unsent()) {
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
void saver.resume();
