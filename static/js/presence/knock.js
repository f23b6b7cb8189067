/**
 * Knocking at the robot, so that a person there comes to its screen. Fetched with the first knock.
 * What becomes of it is read in the robot's state; the line about it goes away when it was read.
 */

import { ask, heard, pass } from "../protocol/robot_action.js";
import { unixNow } from "../lib/clock.js";
import { write } from "../lib/dom.js";
import { freshId } from "../lib/ids.js";

const READ_SECONDS = 8;
const ASKED_IN_VAIN = {
  too_soon: "knock.too_soon",
  declined: "knock.declined",
  nobody_there: "knock.nobody_there",
};

/**
 * The key of the line about a knock, and whether that is its end. Pure.
 * @param {RobotAction | null} action the newest knock
 * @param {{actionId: string, status: string} | null | undefined} known the knock as the robot's
 *   state has it
 * @returns {{word: string, ended: boolean}}
 */
export const lineOfKnock = (action, known) => {
  if (!action) {
    return { word: "", ended: true };
  }
  if (action.status === "FAILED") {
    return {
      word:
        ASKED_IN_VAIN[/** @type {keyof typeof ASKED_IN_VAIN} */ (action.reason)] ?? "knock.failed",
      ended: true,
    };
  }
  if (action.status === "ASKED" || known?.actionId !== action.id) {
    // the robot has taken it; a state that does not say so is old, or the last
    return { word: "knock.asked", ended: action.status !== "ASKED" };
  }
  return { word: `knock.${known.status}`, ended: known.status !== "ringing" };
};

/** @param {Page} page */
export const createKnock = ({ store, driving, element, words }) => {
  /** @type {RobotAction | null} */
  let action = null;
  let word = "";
  let changedAt = 0;

  const show = (/** @type {number} */ now) => {
    const { word: next, ended } = lineOfKnock(action, store.get().robot?.knock);
    if (next !== word) {
      word = next;
      changedAt = now;
    } else if (ended && now - changedAt > READ_SECONDS) {
      action = null;
      word = "";
    }
    const note = element("knock-note");
    note.hidden = word === "";
    write(element("knock-note-text"), word && words.say(word));
  };

  return {
    knock: () => {
      const now = unixNow();
      action = ask({ type: "knock" }, freshId("knock-"), now);
      word = "";
      driving.sendAction(action);
      show(now);
    },
    /** @param {Parameters<typeof heard>[1]} status */
    answered: (status) => {
      if (status.actionId === action?.id) {
        action = heard(action, status, unixNow());
      }
    },
    /** @param {number} now */
    poll: (now) => {
      if (action?.status === "ASKED") {
        const next = pass(action, now);
        action = next.action;
        if (next.send && action) {
          driving.sendAction(action);
        }
      }
      show(now);
    },
  };
};
