/**
 * The script as buttons: a stage is a heading, a step a button with its key and, under its title,
 * what it says or does.
 */

/**
 * @param {any} script @param {HTMLElement} place
 * @param {{describe: (step: any) => string, onPress: (step: any) => void}} options
 * @returns {Map<string, HTMLButtonElement>} by the step's key
 */
export const drawScript = (script, place, { describe, onPress }) => {
  const buttons = new Map();
  const stages = script.stages.map((/** @type {any} */ stage) => {
    const section = document.createElement("section");
    section.className = "wizard-stage";
    section.append(Object.assign(document.createElement("h3"), { textContent: stage.title }));
    for (const step of stage.steps) {
      const button = buttonOf(step, describe(step));
      button.addEventListener("click", () => onPress(step));
      buttons.set(step.key, button);
      section.append(button);
    }
    return section;
  });
  place.replaceChildren(...stages);
  return buttons;
};

/** @param {any} step @param {string} description */
const buttonOf = (step, description) => {
  const button = document.createElement("button");
  button.type = "button";
  button.className = "wizard-step";
  button.dataset.step = step.key;
  const part = (/** @type {string} */ name, /** @type {string} */ text) =>
    Object.assign(document.createElement(name === "wizard-step__key" ? "kbd" : "span"), {
      className: name,
      textContent: text,
    });
  button.append(part("wizard-step__title", step.title), part("wizard-step__does", description));
  if (step.shortcut) {
    button.append(part("wizard-step__key", step.shortcut.toUpperCase()));
  }
  return button;
};

/**
 * @param {Map<string, HTMLButtonElement>} buttons @param {string[]} done @param {boolean} enabled
 * @param {string} running key of the step that the robot does now
 */
export const markSteps = (buttons, done, enabled, running) => {
  for (const [key, button] of buttons) {
    button.disabled = !enabled;
    button.dataset.state = key === running ? "running" : done.includes(key) ? "done" : "";
  }
};
