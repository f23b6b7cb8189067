/**
 * A slider beside the number of each slider question. It shows no thumb before something was
 * chosen.
 */

/** @param {HTMLElement} holder */
export const addRange = (holder) => {
  const number = /** @type {HTMLInputElement} */ (holder.querySelector("input"));
  const range = document.createElement("input");
  range.type = "range";
  range.className = "slider__range";
  for (const name of ["min", "max", "step"])
    range.setAttribute(name, number.getAttribute(name) ?? "");
  // The number beside it is what a keyboard and a screen reader use; two controls with one meaning
  // would only confuse.
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
    range.addEventListener(type, (event) => {
      event.stopPropagation();
      lead(type);
    });
  }
  // A click where the unseen thumb already is changes nothing for the browser, but it is an answer.
  range.addEventListener("click", () => {
    if (number.value === "") lead("change");
  });
  number.addEventListener("input", follow);
  number.addEventListener("survey:restored", follow);
  holder.prepend(range);
  follow();
};
