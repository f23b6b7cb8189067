/**
 * Why a robot without a driver is not assigned: what the server says in `room` and
 * `session/queued` (sessions/protocol.py), with the labels that robots/cards.py has for lists of
 * robots; tests/unit/sessions/test_robot_labels.py binds the two. Pure.
 */

import { reasonFor } from "../../autonomy/reasons.js";

/** The robot is in its station, and not ready yet. */
const CHECKS = new Set(["level", "relocalize", "picture", "network"]);

/** @typedef {"" | "returning" | "checked" | "charging" | "paused" | "held" | "start"} Why */

/**
 * @param {string} told
 * @returns {{why: Why, reason: string}} `checked` is a robot that returned, and looks at itself;
 *   `start` one that is not as a study needs it
 */
export const pauseOf = (told) => {
  const [phase, ...rest] = told.split(":");
  const reason = rest.join(":").trim();
  const why = phase === "returning" && CHECKS.has(reason) ? "checked" : phase;
  return { why: /** @type {Why} */ (why), reason };
};

/**
 * What the robot does between two visits, for visitors outside its queue.
 * @param {string} told
 * @returns {Why} empty when it is ready
 */
export const betweenVisits = (told) => {
  const { why } = pauseOf(told);
  return why === "start" ? "" : why;
};

/**
 * What a robot says of itself to whoever drives it, as it is said to whoever waits: without what to
 * do, and without what the robot is doing that moment, for it has tried again since.
 */
const FOR_WAITING = /** @type {Record<string, string | null>} */ ({
  "reason.before_dock": "because.before_dock",
  "reason.somebody": "because.somebody",
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
