/**
 * What a participant sees of the task: the sentence of the cue, the checkpoints, the time left, and
 * the target. Pure. The session manager decides all of it (`session/task`).
 */

import { isUnderWay } from "../protocol/robot_action.js";
import { roleOf } from "../protocol/session.js";

/**
 * @typedef {object} Progress of the task: the last message of the session manager
 * @property {string} session
 * @property {string} cue
 * @property {number | null} number the checkpoint of the cue, 0 is the dock
 * @property {number | null} x of that checkpoint, m
 * @property {number | null} y
 * @property {number[]} passed
 * @property {number | null} remaining seconds, in the last minutes alone
 * @property {"shut" | "open" | "review"} window of the photo
 * @property {string} photo the action that took it, or empty
 * @property {string} outcome empty while the task continues
 * @property {string[]} doors
 * @property {number | null} endsAt Unix time by the page's clock, from `remaining`
 *
 * @typedef {{number: number, title: string, status: "passed" | "next" | "later"}} Stop
 *
 * @typedef {object} Guide
 * @property {string} cue the word of the sentence
 * @property {number | null} number
 * @property {string} place the title of its checkpoint, or empty
 * @property {Stop[]} stops in the order in which they are passed; the dock, 0, is the last
 * @property {number | null} left seconds, null while there is plenty
 * @property {number | null} driven seconds since the drive began, null before
 */

/** Cues to leave the dock. */
const LEAVE = new Set(["leave_station", "docked_early"]);
const PRACTICE_LAST = 60; // s before its end when a practice drive shows the time left

/**
 * A message of the session manager, with the time at which the task ends.
 * @param {Omit<Progress, "endsAt">} message @param {number} now @returns {Progress}
 */
export const hear = (message, now) => ({
  ...message,
  endsAt: message.remaining === null ? null : now + message.remaining,
});

/** @param {State} state @returns {Guide | null} null when there is nothing to guide */
export const guideFor = (state) => {
  const { study, visit, progress, task } = state;
  if (!study || roleOf(visit) !== "driver") {
    return null;
  }
  if (study.kind === "practice") {
    return {
      cue: "cue.practice",
      number: null,
      place: "",
      stops: [],
      left: leftOf(state) ?? practiceLeft(state),
      driven: drivenIn(state),
    };
  }
  const number = progress?.number ?? null;
  const cue = progress?.cue ?? "wait_for_picture";
  const leaves = LEAVE.has(cue) && isUnderWay(task) && task?.type === "undock";
  return {
    cue: leaves ? "cue.leaving_station" : `cue.${cue}`,
    number,
    place: study.checkpoints.find((/** @type {any} */ stop) => stop.number === number)?.title ?? "",
    stops: stopsOf(study, progress),
    left: leftOf(state),
    driven: drivenIn(state),
  };
};

/** @param {State} state */
const leftOf = ({ progress, now }) =>
  progress === null || progress.endsAt === null || progress.outcome
    ? null
    : Math.max(0, progress.endsAt - now);

/** @param {State} state */
const drivenIn = ({ began, now }) => (began === null ? null : Math.max(0, now - began.at));

/** The time left of a practice drive. @param {State} state */
const practiceLeft = ({ study, began, now }) => {
  const left = began === null ? Infinity : Math.max(0, began.at + study.minutes * 60 - now);
  return left <= PRACTICE_LAST ? left : null;
};

/** @param {any} study @param {Progress | null} progress @returns {Stop[]} */
export const stopsOf = ({ checkpoints }, progress) => {
  const passed = new Set(progress?.passed ?? []);
  const [station, ...others] = checkpoints;
  // the return starts after the photo
  const home = progress !== null && progress.window !== "shut" ? null : station;
  const next = others.find((/** @type {any} */ { number }) => !passed.has(number)) ?? home;
  return [...others, ...(station ? [station] : [])].map(({ number, title }) => ({
    number,
    title,
    status: (number === 0 ? progress?.outcome === "completed" : passed.has(number))
      ? "passed"
      : number === next?.number
        ? "next"
        : "later",
  }));
};

/**
 * The target of the cue, null for a cue without one.
 * @param {State} state @returns {{x: number, y: number, number: number | null} | null}
 */
export const targetOf = ({ progress, study }) => {
  const leads =
    study?.kind === "task" &&
    progress &&
    !progress.outcome &&
    progress.cue !== "leave_station" &&
    progress.window !== "review";
  return leads && progress.x !== null && progress.y !== null
    ? { x: progress.x, y: progress.y, number: progress.number }
    : null;
};
