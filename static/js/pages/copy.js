/**
 * Buttons that copy what a field or another element contains; where the browser forbids it, the
 * text is selected instead. `data-done` is what the button says then.
 */

import { copy } from "../lib/clipboard.js";

for (const button of document.querySelectorAll("[data-copy]")) {
  const words = button.textContent;
  button.hidden = false;
  button.addEventListener("click", async () => {
    const source = document.getElementById(button.dataset.copy);
    const isField = source instanceof HTMLInputElement || source instanceof HTMLTextAreaElement;
    if (!(await copy((isField ? source.value : source.textContent).trim()))) {
      isField ? source.select() : document.getSelection().selectAllChildren(source);
      return;
    }
    button.textContent = button.dataset.done;
    setTimeout(() => {
      button.textContent = words;
    }, 2000);
  });
}
