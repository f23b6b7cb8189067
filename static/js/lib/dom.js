/**
 * Same words are not written again: screen readers would read them again.
 * @param {HTMLElement} element @param {string} text
 */
export const write = (element, text) => {
  if (element.textContent !== text) {
    element.textContent = text;
  }
};

/**
 * The keys drive again, and the space bar stops the robot instead of pressing a button again.
 * @param {GetElement} element
 */
export const backToDriving = (element) => element("viewport").focus({ preventScroll: true });

/**
 * A new element.
 * @param {string} tag @param {string} [name] of its class @param {string} [text] @returns {any}
 */
export const make = (tag, name = "", text = "") =>
  Object.assign(document.createElement(tag), { className: name, textContent: text });

/** @param {string} name of its class @param {string} text @param {() => void} press */
export const makeButton = (name, text, press) => {
  const button = Object.assign(make("button", name, text), { type: "button" });
  button.addEventListener("click", press);
  return button;
};

/** @param {HTMLElement} button @param {boolean} pressed @param {boolean} busy */
export const setPressed = (button, pressed, busy) => {
  button.setAttribute("aria-pressed", String(pressed));
  /** @type {HTMLButtonElement} */ (button).disabled = busy;
};
