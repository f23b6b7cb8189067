/**
 * Asking a robot to release its emergency stop, or a stop between visits: on its own display, and
 * on the drive page of its operators.
 */

import { unixNow } from "../lib/clock.js";
import { freshId } from "../lib/ids.js";

const PATIENCE = 4; // s in which a robot answers

/** @typedef {{id: string, since: number, refused: boolean}} Release what was asked, and when */

/** @param {string} page where it is asked @returns {Release} */
export const newRelease = (page) => ({ id: freshId(page), since: unixNow(), refused: false });

/**
 * Whether a stop holds a robot between visits. A new driver, an operator or a person beside the
 * robot releases it.
 * @param {any} robot its last state, null before one came
 * @param {string | null | undefined} driver
 */
export const isHeld = (robot, driver) =>
  !driver && !robot?.safety.estop && robot?.safety.inhibited === "stopped";

/**
 * The robot refuses by the action's status, and releases without a word of its own: its state says.
 * @param {Release | null} release @param {{actionId: string, status: string}} action
 */
export const isRefusal = (release, action) =>
  release?.id === action.actionId && action.status === "FAILED";

/** @param {Release | null} release @param {number} now @returns {"offered" | "asked" | "failed"} */
export const releaseOf = (release, now) => {
  if (!release) {
    return "offered";
  }
  return release.refused || now - release.since > PATIENCE ? "failed" : "asked";
};
