/** Every light page: the password's "Show", and a menu that closes at a click beside it. */

import { find } from "../lib/page_poll.js";

const all = (/** @type {string} */ selector) =>
  /** @type {NodeListOf<any>} */ (document.querySelectorAll(selector));

for (const button of all("[data-reveal]")) {
  const field = find(`#${button.dataset.reveal}`);
  button.hidden = false;
  button.addEventListener("click", () => {
    const shown = field.type === "password";
    field.type = shown ? "text" : "password";
    button.textContent = shown ? button.dataset.hide : button.dataset.show;
    button.setAttribute("aria-pressed", String(shown));
  });
  // The browser's form history would store a password that is sent as plain text.
  field.form?.addEventListener("submit", () => {
    field.type = "password";
  });
}

for (const menu of all("[data-menu]")) {
  document.addEventListener("click", (event) => {
    if (!menu.contains(event.target)) menu.open = false;
  });
  menu.addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => {
    if (event.key !== "Escape" || !menu.open) return;
    menu.open = false;
    menu.querySelector("summary").focus();
  });
}
