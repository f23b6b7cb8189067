/** A slider beside the number of each slider question, without a thumb before the first choice. */

import { make } from "../../lib/dom.js";

/** @param {HTMLElement} holder */
export const addRange = (holder) => {
  const number = /** @type {HTMLInputElement} */ (holder.querySelector("input"));
  const range = make("input", "slider__range");
  range.type = "range";
  for (const name of ["min", "max", "step"])
    range.setAttribute(name, number.getAttribute(name) ?? "");
  // A keyboard and a screen reader use the number beside it.
  range.tabIndex = -1;
  range.setAttribute("aria-hidden", "true");

  const follow = () => {
    range.toggleAttribute("data-empty", number.value === "");
    if (number.value !== "") range.value = number.value;
  };
  const lead = (/** @type {string} */ type) => {
    number.value = range.value;
    follow();
    number.dispatchEvent(new Event(type, { bubbles: true }));
  };
  for (const type of ["input", "change"]) {
    range.addEventListener(type, (/** @type {Event} */ event) => {
      event.stopPropagation();
      lead(type);
    });
  }
  // A click at the hidden thumb is an answer, although the browser reports no change.
  range.addEventListener("click", () => {
    if (number.value === "") lead("change");
  });
  number.addEventListener("input", follow);
  number.addEventListener("survey:restored", follow);
  holder.prepend(range);
  follow();
};
