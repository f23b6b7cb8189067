/**
 * The page's buttons: stop, leave, sound, map, speed and assistance. A button that was pressed with
 * a pointer loses the focus, so that the space bar stops the robot instead of pressing it again.
 */

import { roleOf } from "../../protocol/session.js";
import { isAssistFixed, offersAssist, offersSound } from "../../protocol/capabilities.js";
import { assistIn } from "../../autonomy/assistance.js";
import { pressStop, write } from "../../lib/dom.js";

/**
 * @param {GetElement} element @param {Words} words @param {(action: string) => void} act
 * @returns {(state: State) => void}
 */
export const createControls = (element, words, act) => {
  const one = (/** @type {string} */ id) => /** @type {HTMLButtonElement} */ (element(id));
  const all = (/** @type {string} */ id) => Array.from(element(id).querySelectorAll("button"));
  const [stop, leave, sound] = [one("stop"), one("leave"), one("sound")];
  const [map, turn] = [one("map-toggle"), one("turn-around")];
  const [speeds, assists] = [all("speed"), all("assist")];

  for (const button of [leave, sound, map, turn, ...all("map-tools"), ...speeds, ...assists]) {
    button.addEventListener("click", (event) => {
      act(button.dataset.action ?? "");
      if (event.detail > 0) {
        button.blur();
      }
    });
  }
  pressStop(stop, () => act("stop"));

  return (state) => {
    const role = roleOf(state.visit);
    stop.disabled = role === "";
    stop.toggleAttribute("data-pending", state.stopping);
    // the card has a way out of the queue
    leave.hidden = role === "" || !["driving", "watching"].includes(state.visit.phase);
    sound.hidden = role === "" || state.slow; // pictures through the server have no sound
    sound.setAttribute("aria-pressed", String(state.sound));
    const { mic, camera } = state.own;
    const isAsked = offersSound(state) && (!state.soundChosen || mic !== "off" || camera === "on");
    sound.toggleAttribute("data-asked", isAsked);
    const sounds = state.sound ? "do.sound_off" : isAsked ? "do.hear" : "do.sound_on";
    write(element("sound-text"), words.say(sounds));
    const { robot } = state;
    const mayTurn = role === "driver" && state.playing && robot;
    turn.hidden = !mayTurn || robot.docked || robot.safety.estop;
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
