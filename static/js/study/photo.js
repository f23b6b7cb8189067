/**
 * The photo's window: what it shows, and which of its buttons can be pressed. Pure. It opens and
 * closes when the session manager says so; taking a picture is never refused, wherever the robot
 * looks.
 */

import { roleOf } from "../protocol/session.js";
import { isUnderWay } from "../protocol/robot_action.js";

/**
 * @typedef {object} Window
 * @property {"hint" | "review"} mode
 * @property {string} word its sentence
 * @property {string} photo the action whose picture is to be judged, or nothing
 * @property {boolean} busy a picture, or an answer, is on its way
 */

/** @param {State} state @returns {Window | null} */
export const windowFor = ({ visit, told, snap, answer }) => {
  if (roleOf(visit) !== "driver" || !told || told.outcome || told.window === "shut") {
    return null;
  }
  if (told.window === "review") {
    return { mode: "review", word: "photo.review", photo: told.photo, busy: answer !== null };
  }
  const taking = isUnderWay(snap) || snap?.status === "FINISHED";
  const skipped = answer !== null;
  return {
    mode: "hint",
    word: taking
      ? "photo.taking"
      : snap?.status === "FAILED"
        ? "photo.failed"
        : `photo.${told.cue}`,
    photo: "",
    busy: taking || skipped,
  };
};

const AGAIN_SECONDS = 1.5; // an answer that the session manager has not taken up is said again

/**
 * @typedef {object} Answer what the visitor chose, until the window shows that it was understood
 * @property {string} id
 * @property {string} photo
 * @property {"keep" | "again" | "skip"} choice
 * @property {number} at Unix seconds
 * @property {number} saidAt
 */

/**
 * What news and time do to an answer.
 * @param {Answer | null} answer @param {import("./guide.js").Told | null} told @param {number} now
 * @returns {{answer: Answer | null, say: boolean}}
 */
export const pursue = (answer, told, now) => {
  // A question that is not asked any more was answered: the window is shut, or it shows something
  // else than what was judged.
  if (!answer || !told || told.outcome || told.window === "shut" || told.photo !== answer.photo) {
    return { answer: null, say: false };
  }
  return now - answer.saidAt > AGAIN_SECONDS
    ? { answer: { ...answer, saidAt: now }, say: true }
    : { answer, say: false };
};
