/** Copies a text that stands on the page; without this script, or where the browser forbids it, the text can be marked by hand. */

import { copy } from "../lib/clipboard.js";

for (const button of document.querySelectorAll("[data-copy]")) {
  const words = button.textContent;
  button.hidden = false;
  button.addEventListener("click", async () => {
    const source = document.getElementById(button.dataset.copy);
    if (!(await copy(source.textContent.trim()))) {
      document.getSelection().selectAllChildren(source);
      return;
    }
    button.textContent = button.dataset.done;
    setTimeout(() => {
      button.textContent = words;
    }, 2000);
  });
}
