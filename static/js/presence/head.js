/** The robot's head on the drive page: its slider and its keys. */

import { isOffered } from "../protocol/capabilities.js";
import { ask } from "../protocol/robot_action.js";
import { unixNow } from "../lib/clock.js";
import { backToDriving } from "../lib/dom.js";
import { freshId } from "../lib/ids.js";
import { STEP, Tilting } from "./tilt.js";

/** @param {HTMLInputElement} slider @param {number} angle rad @param {Words} words */
const showAngle = (slider, angle, words) => {
  if (Math.abs(Number(slider.value) - angle) > 0.005) {
    slider.value = String(angle);
  }
  const degrees = Math.round((Math.abs(angle) * 180) / Math.PI);
  const word = degrees === 0 ? "tilt.level" : angle > 0 ? "tilt.down" : "tilt.up";
  const text = words.say(word, { degrees });
  if (slider.getAttribute("aria-valuetext") !== text) {
    slider.setAttribute("aria-valuetext", text);
  }
};

/** @param {State} state */
const rangeOf = (state) =>
  isOffered(state, "tilt") && state.playing ? state.factsheet.tilt : null;

/** @param {Page} page */
export const createHead = ({ store, element, driving, words }) => {
  const slider = /** @type {HTMLInputElement} */ (element("tilt-slider"));
  const tilting = new Tilting();

  /** @param {number} angle rad */
  const tiltTo = (angle) => {
    const { factsheet } = store.get();
    if (factsheet?.tilt && isOffered(store.get(), "tilt")) {
      tilting.want(angle, factsheet.tilt);
      store.update({});
    }
  };
  slider.addEventListener("input", () => tiltTo(Number(slider.value)));
  slider.addEventListener("pointerdown", () => tilting.hold(Number(slider.value)));
  for (const end of ["pointerup", "pointercancel"]) {
    slider.addEventListener(end, () => {
      tilting.letGo();
      backToDriving(element); // the arrow keys drive again
    });
  }

  /** @param {number} change rad, positive looks down */
  const step = (change) => ({
    down: () => {
      const { robot, factsheet } = store.get();
      if (factsheet?.tilt) {
        tiltTo((tilting.shown(robot?.tilt ?? null, unixNow()) ?? factsheet.tilt.home) + change);
      }
    },
  });

  return {
    keys: { look_up: step(-STEP), look_down: step(STEP) },
    /** @param {number} now */
    poll: (now) => {
      const angle = tilting.take(now);
      if (angle !== null) {
        driving.sendAction(ask({ type: "tilt", angle }, freshId("tilt-"), now));
      }
    },
    /** @param {State} state */
    changed: (state) => {
      if (!rangeOf(state)) {
        tilting.letGo(); // a hidden slider gets no pointerup
      }
    },
    /** @param {State} state */
    render: (state) => {
      const range = rangeOf(state);
      element("tilt").hidden = !range;
      if (range) {
        Object.assign(slider, { min: range.minimum, max: range.maximum, step: "0.01" });
        const shown = tilting.shown(state.robot?.tilt ?? null, unixNow());
        if (shown !== null) {
          showAngle(slider, shown, words);
        }
      }
    },
  };
};
