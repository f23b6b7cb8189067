/**
 * The page's buttons: stop, leave, sound, map, speed and assistance. A button that was pressed with
 * a pointer gives the focus back, so that the space bar stops the robot instead of pressing it
 * again.
 */

import { roleOf } from "../../protocol/session.js";
import { isAssistFixed, offersAssist } from "../../protocol/capabilities.js";
import { assistIn } from "../../autonomy/assistance.js";
import { write } from "../../lib/dom.js";

/**
 * @param {GetElement} element @param {Words} words @param {(action: string) => void} act
 * @returns {(state: State) => void}
 */
export const createControls = (element, words, act) => {
  const stop = /** @type {HTMLButtonElement} */ (element("stop"));
  const leave = /** @type {HTMLButtonElement} */ (element("leave"));
  const sound = /** @type {HTMLButtonElement} */ (element("sound"));
  const map = /** @type {HTMLButtonElement} */ (element("map-toggle"));
  const turn = /** @type {HTMLButtonElement} */ (element("turn-around"));
  const tools = /** @type {HTMLButtonElement[]} */ (
    Array.from(element("map-tools").querySelectorAll("button"))
  );
  const speeds = /** @type {HTMLButtonElement[]} */ (
    Array.from(element("speed").querySelectorAll("button"))
  );
  const assists = /** @type {HTMLButtonElement[]} */ (
    Array.from(element("assist").querySelectorAll("button"))
  );

  for (const button of [leave, sound, map, turn, ...tools, ...speeds, ...assists]) {
    button.addEventListener("click", (event) => {
      act(button.dataset.action ?? "");
      if (event.detail > 0) {
        button.blur();
      }
    });
  }
  setUpStop(stop, act);

  return (state) => {
    const role = roleOf(state.visit);
    stop.disabled = role === "";
    stop.toggleAttribute("data-pending", state.stopping);
    leave.hidden = role === "";
    sound.hidden = role === "" || state.slow; // pictures through the server have no sound
    sound.setAttribute("aria-pressed", String(state.sound));
    write(element("sound-text"), words.say(state.sound ? "do.sound_off" : "do.sound_on"));
    turn.hidden =
      role !== "driver" ||
      !state.playing ||
      !state.robot ||
      state.robot.docked ||
      state.robot.safety.estop;
    map.setAttribute("aria-expanded", String(state.mapOpen));
    element("drive-page").toggleAttribute("data-map-closed", !state.mapOpen);
    write(element("map-toggle-text"), words.say(state.mapOpen ? "do.map_hide" : "do.map_show"));
    speeds.forEach((button, step) => {
      button.disabled = state.visit.phase !== "driving";
      button.setAttribute("aria-pressed", String(step === state.speedStep));
    });
    element("assist").hidden = !offersAssist(state.factsheet) || isAssistFixed(state);
    for (const button of assists) {
      const level = (button.dataset.action ?? "").slice("assist-".length);
      button.disabled = state.visit.phase !== "driving";
      button.setAttribute("aria-pressed", String(level === assistIn(state)));
      button.toggleAttribute("data-asked", level === state.assistAsked?.level);
    }
  };
};

/**
 * At the moment of pressing, not of lifting: a stop is not to be thought over.
 * @param {HTMLButtonElement} stop @param {(action: string) => void} act
 */
const setUpStop = (stop, act) => {
  stop.addEventListener("pointerdown", (event) => {
    event.preventDefault();
    act("stop");
  });
  stop.addEventListener("click", (event) => {
    if (event.detail === 0) {
      act("stop");
    }
  });
};
