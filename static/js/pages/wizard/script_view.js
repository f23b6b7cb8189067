/** The script as buttons: a heading for each stage, a button for each step with its key. */

import { make, makeButton } from "../../lib/dom.js";

/**
 * @param {any} script @param {HTMLElement} place
 * @param {{describe: (step: any) => string, onPress: (step: any) => void}} options
 * @returns {Map<string, HTMLButtonElement>} by the step's key
 */
export const drawScript = (script, place, { describe, onPress }) => {
  const buttons = new Map();
  const stages = script.stages.map((/** @type {any} */ stage) => {
    const section = make("section", "wizard-stage");
    section.append(make("h3", "", stage.title));
    for (const step of stage.steps) {
      const button = buttonOf(step, describe(step), () => onPress(step));
      buttons.set(step.key, button);
      section.append(button);
    }
    return section;
  });
  place.replaceChildren(...stages);
  return buttons;
};

/** @param {any} step @param {string} description @param {() => void} press */
const buttonOf = (step, description, press) => {
  const button = makeButton("wizard-step", "", press);
  button.dataset.step = step.key;
  button.append(
    make("span", "wizard-step__title", step.title),
    make("span", "wizard-step__does", description),
  );
  if (step.shortcut) {
    button.append(make("kbd", "wizard-step__key", step.shortcut.toUpperCase()));
  }
  return button;
};

/**
 * @param {Map<string, HTMLButtonElement>} buttons @param {string[]} done @param {boolean} enabled
 * @param {string} running key of the present step
 */
export const markSteps = (buttons, done, enabled, running) => {
  for (const [key, button] of buttons) {
    button.disabled = !enabled;
    button.dataset.state = key === running ? "running" : done.includes(key) ? "done" : "";
  }
};
