/**
 * Asking a robot to release its emergency stop: on its own display, and on the drive page of
 * somebody who operates it.
 */

import { unixNow } from "../lib/clock.js";
import { freshId } from "../lib/ids.js";

const PATIENCE = 4; // s in which a robot answers

/** @typedef {{id: string, since: number, refused: boolean}} Release what was asked, and when */

/** @param {string} page where it is asked @returns {Release} */
export const newRelease = (page) => ({ id: freshId(page), since: unixNow(), refused: false });

/**
 * The robot refuses by the action's status, and releases without a word of its own: its state says.
 * @param {Release | null} release
 * @param {{actionId: string, status: string}} action
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
