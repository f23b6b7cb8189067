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

/** @param {HTMLElement} button @param {boolean} pressed @param {boolean} busy */
export const setPressed = (button, pressed, busy) => {
  button.setAttribute("aria-pressed", String(pressed));
  /** @type {HTMLButtonElement} */ (button).disabled = busy;
};
