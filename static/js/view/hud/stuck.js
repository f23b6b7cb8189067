/**
 * Why the robot does not move although the visitor steers, from what the page knows and the robot
 * reports. Pure. Other alerts (alert.js) come first; these are the remaining reasons, and a
 * sentence for an unknown one.
 */

import { reports } from "../../protocol/standstill.js";

const PATIENCE = 0.5; // s of input without motion
const SILENCE = 1; // s without a message of the robot

/**
 * Why the robot refuses commands (robots/agent/safety: freshness.py, permissions.py, kernel.py).
 * @type {Record<string, string>}
 */
const REFUSALS = {
  stale: "late",
  future: "late",
  frame_stale: "old_picture",
  frame_future: "old_picture",
  no_frame: "old_picture",
  clock_unknown: "measuring",
  stopped: "held",
  not_allowed: "not_allowed",
  no_lease: "not_yours",
  observer: "not_yours",
  wrong_session: "not_yours",
  wrong_epoch: "not_yours",
};

/** @typedef {{word: string, values?: Record<string, string>}} Why */

/**
 * @param {State} state
 * @param {{now: number, heardAt: number, movedAt: number}} times Unix seconds: of the robot's last
 *   message, and of its last motion
 * @returns {Why | null} null when the visitor does not steer, or the robot moves
 */
export const stuckFor = (state, { now, heardAt, movedAt }) => {
  const { visit, pressing, robot, stopping, roundTrip } = state;
  const still =
    pressing === null || visit.phase !== "driving" ? 0 : now - Math.max(pressing.since, movedAt);
  if (still < PATIENCE) {
    return null;
  }
  if (stopping) {
    return { word: "stuck.stopping" };
  }
  if (!robot || now - heardAt > SILENCE) {
    return { word: "stuck.silent" };
  }
  if (robot.visitorSilence > SILENCE) {
    return { word: "stuck.unheard" };
  }
  if (!state.playing) {
    return { word: "stuck.no_picture" };
  }
  return (
    robotSays(robot) ?? (still < PATIENCE + (roundTrip ?? 0) ? null : { word: "stuck.unknown" })
  );
};

/** @param {any} robot its state @returns {Why | null} */
const robotSays = ({ safety, refused, errors }) => {
  if (safety.inhibited === "stopped" || safety.inhibited === "no_lease") {
    return { word: safety.inhibited === "stopped" ? "stuck.held" : "stuck.not_yours" };
  }
  if (safety.inhibited === "collision") {
    return { word: "stuck.contact" };
  }
  if (safety.inhibited === "unconfirmed") {
    return { word: "alert.cancel" };
  }
  if (safety.inhibited === "settling") {
    return { word: reports({ errors }, "settling") ? "stuck.never_rests" : "stuck.settling" };
  }
  const [most] = Object.entries(refused ?? {})
    .sort(([, one], [, other]) => other - one)
    .filter(([reason]) => reason in REFUSALS);
  if (most) {
    return { word: `stuck.${REFUSALS[most[0]]}` };
  }
  // a full disk does not stop the robot
  const error = errors?.find((/** @type {string} */ one) => !one.startsWith("disk_"));
  return error ? { word: "stuck.error", values: { error: error.replace(/\.$/, "") } } : null;
};
