/** The robot's head on the drive page: its slider and its keys. */

import { isOffered } from "../autonomy/offer.js";
import { ask } from "../autonomy/robot_action.js";
import { unixNow } from "../lib/clock.js";
import { backToDriving } from "../lib/dom.js";
import { freshId } from "../lib/ids.js";
import { STEP, Tilting } from "./tilt.js";

/** @param {import("../drive/registry.js").Page} page */
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
  // the arrows are to drive again, and not to nod
  slider.addEventListener("pointerup", () => backToDriving(element));

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
    /** @param {import("../drive/features.js").State} state */
    render: (state) => {
      const range = isOffered(state, "tilt") && state.playing ? state.factsheet.tilt : null;
      element("tilt").hidden = !range;
      if (range) {
        Object.assign(slider, {
          min: String(range.minimum),
          max: String(range.maximum),
          step: "0.01",
        });
        const shown = tilting.shown(state.robot?.tilt ?? null, unixNow());
        if (shown !== null && Math.abs(Number(slider.value) - shown) > 0.005) {
          slider.value = String(shown);
        }
        if (shown !== null) {
          const degrees = Math.round((Math.abs(shown) * 180) / Math.PI);
          const said = words.say(
            degrees === 0 ? "tilt.level" : shown > 0 ? "tilt.down" : "tilt.up",
            { degrees },
          );
          if (slider.getAttribute("aria-valuetext") !== said) {
            slider.setAttribute("aria-valuetext", said);
          }
        }
      }
    },
  };
};
