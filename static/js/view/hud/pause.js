/**
 * Why a robot without a driver is not ready, from `room` and `session/queued`
 * (sessions/protocol.py), with the labels of robots/cards.py, which
 * tests/unit/sessions/test_robot_labels.py compares. Pure.
 */

import { reasonFor } from "../../autonomy/reasons.js";

/** The robot is docked, and not ready yet. */
const CHECKS = new Set(["level", "relocalize", "picture", "network"]);

/** @typedef {"" | "returning" | "checked" | "charging" | "paused" | "held" | "start" |
 *   "maintenance"} Why */

/**
 * @param {string} pause the server's: a word, a colon, and a reason
 * @returns {{why: Why, reason: string}} `checked`: a robot that has returned and is being checked;
 *   `start`: not as a study needs it
 */
export const pauseOf = (pause) => {
  const [phase, ...rest] = pause.split(":");
  const reason = rest.join(":").trim();
  const why = phase === "returning" && CHECKS.has(reason) ? "checked" : phase;
  return { why: /** @type {Why} */ (why), reason };
};

/**
 * The same for visitors outside its queue.
 * @param {string} pause @returns {Why} empty when it is ready
 */
export const betweenVisits = (pause) => {
  const { why } = pauseOf(pause);
  return why === "start" ? "" : why;
};

/**
 * The words for waiting visitors in place of those for the driver: without advice, and without what
 * the robot is doing at the moment.
 */
const FOR_WAITING = /** @type {Record<string, string | null>} */ ({
  "reason.before_dock": "because.before_dock",
  "reason.person": "because.person",
  "reason.very_close": "because.very_close",
  "reason.waits_for_route": "reason.all_blocked",
  "reason.not_found": "because.lost",
  "reason.lost": "because.lost",
  "reason.in_wall": null,
  "reason.tries_again": null,
  "reason.backs_off": null,
  "reason.looks_for_dock": null,
});

/**
 * @param {string} reason
 * @returns {{word: string, values?: Record<string, string>} | null}
 */
export const reasonForWaiting = (reason) => {
  const found = reasonFor(reason);
  if (!found || !(found.word in FOR_WAITING)) {
    return found;
  }
  const word = FOR_WAITING[found.word];
  return word ? { word } : null;
};
