/** What the live view says of robots and drives, as text. Pure. */

import { written } from "../replay/timeline.js";

const OLD = 5; // s after which a state is called old
const NONE = "–";

/** @param {number} stamp Unix seconds @returns {string} */
export const timeOf = (stamp) => new Date(stamp * 1000).toLocaleTimeString();

/**
 * How long, in minutes and seconds.
 * @param {number | null | undefined} seconds @returns {string}
 */
export const lasted = (seconds) =>
  seconds === null || seconds === undefined ? NONE : written(Math.max(0, seconds));

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
  const parts = [
    drive.code,
    words.say(drive.kind),
    words.say("session", { k: drive.number }),
    drive.condition,
    words.say(drive.state),
    old,
  ];
  return parts.filter(Boolean).join(" · ");
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
  return [words.say(`wizard_${wizard.status}`), step, deviation].filter(Boolean).join(" · ");
};

/** @param {any} drive or null @param {Words} words @returns {string} */
export const taskOf = (drive, words) => {
  const task = drive?.task;
  if (!task) {
    return NONE;
  }
  const cue = task.cue ? words.say(`cue.${task.cue}`, { k: task.number ?? "" }) : "";
  return [words.say("passed", { n: task.passed.length, all: task.checkpoints }), cue]
    .filter(Boolean)
    .join(" · ");
};

/** @param {any} network or null @param {Words} words @returns {string} */
export const networkOf = (network, words) => {
  if (!network || network.age > OLD) {
    return NONE;
  }
  const { roundTrip, loss, fps } = network;
  const parts = [
    roundTrip === null || roundTrip === undefined ? "" : `${Math.round(roundTrip * 1000)} ms`,
    loss === null || loss === undefined ? "" : `${(loss * 100).toFixed(1)} % ${words.say("loss")}`,
    fps === null || fps === undefined ? "" : `${Math.round(fps)} ${words.say("fps")}`,
    network.path,
  ];
  return parts.filter(Boolean).join(" · ") || NONE;
};

/** @param {any} robot @param {Words} words @returns {string} */
export const batteryOf = (robot, words) => {
  const charge = robot.battery?.charge;
  const share = charge === undefined || charge === null ? NONE : `${Math.round(charge * 100)} %`;
  return [
    share,
    robot.battery?.charging ? words.say("charging") : "",
    robot.docked ? words.say("docked") : "",
  ]
    .filter(Boolean)
    .join(" · ");
};

/**
 * How each door is, as far as is known: as the robot says, else as it was set, by the condition
 * where somebody drives in one.
 * @param {any} robot
 * @param {any} drive or null
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
 * Each door as it was set, by the condition where somebody drives in one, and as the robot says it
 * is.
 * @param {any} robot
 * @param {any} drive or null
 * @param {Words} words @returns {string}
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

/**
 * @param {string[]} queue codes, empty for those outside the study
 * @param {Words} words @returns {string}
 */
export const queueOf = (queue, words) =>
  queue.map((code) => code || words.say("somebody")).join(", ") || words.say("nobody");
