/**
 * The window of the photo and its buttons. Pure. The session manager opens and closes it; a photo
 * is never refused, wherever the robot looks.
 */

import { roleOf } from "../protocol/session.js";
import { isUnderWay } from "../protocol/robot_action.js";

/**
 * @typedef {object} Window
 * @property {"hint" | "review"} mode
 * @property {string} word its sentence
 * @property {string} photo the action whose photo is reviewed, or empty
 * @property {boolean} busy while a photo is taken or an answer is sent
 */

/** @param {State} state @returns {Window | null} */
export const windowFor = ({ visit, progress, snap, answer }) => {
  if (roleOf(visit) !== "driver" || !progress || progress.outcome || progress.window === "shut") {
    return null;
  }
  if (progress.window === "review") {
    return { mode: "review", word: "photo.review", photo: progress.photo, busy: answer !== null };
  }
  const taking = isUnderWay(snap) || snap?.status === "FINISHED";
  const hint = snap?.status === "FAILED" ? "photo.failed" : `photo.${progress.cue}`;
  const word = taking ? "photo.taking" : hint;
  return { mode: "hint", word, photo: "", busy: taking || answer !== null };
};

const AGAIN_SECONDS = 1.5; // until an answer that the session manager has not confirmed is repeated

/**
 * @typedef {object} Answer the visitor's choice, until it is confirmed
 * @property {string} id
 * @property {string} photo
 * @property {"keep" | "again" | "skip"} choice
 * @property {number} at Unix seconds
 * @property {number} saidAt
 */

/**
 * The answer after a message or a time, and whether to repeat it.
 * @param {Answer | null} answer @param {import("./guide.js").Progress | null} progress
 * @param {number} now
 * @returns {{answer: Answer | null, say: boolean}}
 */
export const answerAfter = (answer, progress, now) => {
  // The answer was confirmed when the window is shut, or shows another photo.
  if (
    !answer ||
    !progress ||
    progress.outcome ||
    progress.window === "shut" ||
    progress.photo !== answer.photo
  ) {
    return { answer: null, say: false };
  }
  return now - answer.saidAt > AGAIN_SECONDS
    ? { answer: { ...answer, saidAt: now }, say: true }
    : { answer, say: false };
};
