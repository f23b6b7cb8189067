/**
 * Buttons that copy what a field or another element contains; where the browser forbids it, the
 * text is selected instead. `data-done` is what the button says then.
 */

import { copy } from "../lib/clipboard.js";
import { find } from "../lib/page_poll.js";

const buttons = /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll("[data-copy]"));

for (const button of buttons) {
  const words = button.textContent;
  button.hidden = false;
  button.addEventListener("click", async () => {
    const source = find(`#${button.dataset.copy}`);
    const isField = source instanceof HTMLInputElement || source instanceof HTMLTextAreaElement;
    if (!(await copy((isField ? source.value : source.textContent).trim()))) {
      isField ? source.select() : document.getSelection()?.selectAllChildren(source);
      return;
    }
    button.textContent = button.dataset.done ?? words;
    setTimeout(() => {
      button.textContent = words;
    }, 2000);
  });
}
