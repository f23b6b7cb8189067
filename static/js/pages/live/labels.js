/** The texts of the live view about robots and drives. Pure. */

import { formatted, inMs, inPercent, listed, NONE } from "../replay/readings.js";
import { written } from "../replay/timeline.js";

const OLD = 5; // s after which a state is old

/** @param {number} stamp Unix seconds @returns {string} */
export const timeOf = (stamp) => new Date(stamp * 1000).toLocaleTimeString();

/** Minutes and seconds. @param {number | null | undefined} seconds */
export const lasted = (seconds) => formatted(seconds, (value) => written(Math.max(0, value)));

/** @param {any} robot @param {any} drive or null @param {Words} words @returns {string} */
export const stateOf = (robot, drive, words) => {
  if (!robot.online) {
    return words.say("offline");
  }
  if (robot.estop) {
    return words.say("estop");
  }
  if (robot.held) {
    return words.say("held", { why: robot.held });
  }
  if (!drive && robot.unready) {
    return words.say("unready", { why: robot.unready });
  }
  return drive ? words.say("driven") : words.say(robot.turnaround, { why: robot.reason });
};

/** @param {any} drive or null @param {Words} words @returns {string} */
export const driverOf = (drive, words) => {
  if (!drive) {
    return words.say("nobody");
  }
  const old =
    drive.heard !== null && drive.heard > OLD ? words.say("old", { s: lasted(drive.heard) }) : "";
  const errors = drive.script_errors ? words.say("script_errors", { n: drive.script_errors }) : "";
  const session = words.say("session", { k: drive.number });
  const state = words.say(drive.state);
  return listed(drive.code, words.say(drive.kind), session, drive.condition, state, old, errors);
};

/** @param {any} drive or null @param {Words} words @returns {string} */
export const wizardOf = (drive, words) => {
  const wizard = drive?.wizard;
  if (!wizard) {
    return NONE;
  }
  const deviation = wizard.deviation ? words.say(`wizard_${wizard.deviation}`) : "";
  const step = wizard.step
    ? words.say("wizard_step", { step: wizard.step, s: lasted(wizard.age) })
    : "";
  return listed(words.say(`wizard_${wizard.status}`), step, deviation);
};

/** @param {any} drive or null @param {Words} words @returns {string} */
export const taskOf = (drive, words) => {
  const task = drive?.task;
  if (!task) {
    return NONE;
  }
  const cue = task.cue ? words.say(`cue.${task.cue}`, { k: task.number ?? "" }) : "";
  return listed(words.say("passed", { n: task.passed.length, all: task.checkpoints }), cue);
};

/** @param {any} network or null @param {Words} words @returns {string} */
export const networkOf = (network, words) => {
  if (!network || network.age > OLD) {
    return NONE;
  }
  const { roundTrip, loss, fps, path } = network;
  const trip = roundTrip == null ? "" : inMs(roundTrip);
  const lost = loss == null ? "" : `${inPercent(loss, 1)} ${words.say("loss")}`;
  const rate = fps == null ? "" : `${Math.round(fps)} ${words.say("fps")}`;
  return listed(trip, lost, rate, path) || NONE;
};

/** @param {any} robot @param {Words} words @returns {string} */
export const batteryOf = ({ battery, docked }, words) =>
  listed(
    inPercent(battery?.charge),
    battery?.charging ? words.say("charging") : "",
    docked ? words.say("docked") : "",
  );

/**
 * The state of each door: as the robot reports it, else as set for the condition of the drive, or
 * for the robot.
 * @param {any} robot @param {any} drive or null
 * @returns {Record<string, string>} open or closed, by name
 */
export const doorStates = (robot, drive) =>
  Object.fromEntries(
    robot.doors.map((/** @type {any} */ door) => [
      door.name,
      door.confirmed ?? drive?.doors?.[door.name] ?? door.set,
    ]),
  );

/**
 * Each door as it was set, and as the robot reports it.
 * @param {any} robot @param {any} drive or null @param {Words} words @returns {string}
 */
export const doorsOf = (robot, drive, words) =>
  robot.doors
    .map((/** @type {any} */ door) => {
      const set = words.say(drive?.doors?.[door.name] ?? door.set);
      const says = door.confirmed
        ? words.say("confirmed", { state: words.say(door.confirmed), t: timeOf(door.at) })
        : words.say("unconfirmed");
      return `${door.title}: ${set} (${says})`;
    })
    .join("; ") || NONE;

/** @param {string[]} queue codes, empty for visitors outside the study @param {Words} words */
export const queueOf = (queue, words) =>
  queue.map((code) => code || words.say("somebody")).join(", ") || words.say("nobody");
