/**
 * The release of a robot's emergency stop, or of a stop between visits: requested on its own
 * display, or on the drive page by its operators.
 */

import { unixNow } from "../lib/clock.js";
import { freshId } from "../lib/ids.js";

const PATIENCE = 4; // s until a release without an answer has failed

/** @typedef {{id: string, since: number, refused: boolean}} Release */

/** @param {string} page prefix of its id @returns {Release} */
export const newRelease = (page) => ({ id: freshId(page), since: unixNow(), refused: false });

/**
 * Whether a stop holds a robot between visits. A new driver, an operator or a person beside the
 * robot releases it.
 * @param {any} robot its last state, or null @param {string | null | undefined} driver
 */
export const isHeld = (robot, driver) =>
  !driver && !robot?.safety.estop && robot?.safety.inhibited === "stopped";

/**
 * Whether the robot refuses, by the action's status. It confirms a release by its state only.
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
