/**
 * Knocking at the robot, so that a person there comes to its display. Fetched with the first knock.
 * The robot's state has its outcome; the note about it is shown for a moment.
 */

import { ask, heard, pursue } from "../protocol/robot_action.js";
import { unixNow } from "../lib/clock.js";
import { write } from "../lib/dom.js";
import { freshId } from "../lib/ids.js";

const READ_SECONDS = 8;
/** @type {Record<string, string>} by the robot's reason */
const FAILURES = {
  too_soon: "knock.too_soon",
  declined: "knock.declined",
  nobody_there: "knock.nobody_there",
};

/**
 * The key of the note about a knock, and whether it has ended. Pure.
 * @param {RobotAction | null} action the newest knock
 * @param {{actionId: string, status: string} | null | undefined} known in the robot's state
 * @returns {{word: string, ended: boolean}}
 */
export const lineOfKnock = (action, known) => {
  if (!action) {
    return { word: "", ended: true };
  }
  if (action.status === "FAILED") {
    return { word: FAILURES[action.reason] ?? "knock.failed", ended: true };
  }
  if (action.status === "ASKED" || known?.actionId !== action.id) {
    // a state without it is an old one, or the last
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
        action = pursue(action, now, driving.sendAction);
      }
      show(now);
    },
  };
};
