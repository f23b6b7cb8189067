/**
 * The page's element of an id. The template determines its kind.
 * @param {string} id @returns {any}
 */
export const element = (id) => document.getElementById(id);

/** What the template tells the script. @returns {any} */
export const readConfig = () => JSON.parse(element("config").textContent);

/**
 * Writes a text unless it is there already: screen readers would read it again.
 * @param {HTMLElement} element @param {string} text
 */
export const write = (element, text) => {
  if (element.textContent !== text) {
    element.textContent = text;
  }
};

/**
 * Gives the focus to the video: the arrow keys drive again, and the space bar stops the robot
 * instead of pressing a button again.
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

/**
 * Shows a button, or hides it without an action.
 * @param {HTMLElement} button @param {{action: string, word: string} | undefined} what
 * @param {Words} words
 */
export const showButton = (button, what, words) => {
  button.hidden = !what;
  button.dataset.action = what?.action ?? "";
  write(button, what ? words.say(what.word) : "");
};

/**
 * A stop acts when its button is pressed, not when it is released.
 * @param {HTMLElement} button @param {() => void} stop
 */
export const pressStop = (button, stop) => {
  button.addEventListener("pointerdown", (event) => {
    event.preventDefault();
    stop();
  });
  button.addEventListener("click", (event) => {
    if (event.detail === 0) {
      stop(); // by a key
    }
  });
};

/** The image of an address, once it can be drawn. @param {string} url */
export const loadImage = async (url) => {
  const image = new Image();
  image.src = url;
  await image.decode();
  return image;
};
