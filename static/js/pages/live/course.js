/** The course of a study on a robot's map in the live view, and the driven path. Pure. */

import { marksFor } from "../../study/course.js";

const TASK = { window: "shut", outcome: "" };

/**
 * The course of the drive, with its passed checkpoints; without a drive, that of the version that
 * is shown, with no next checkpoint. A practice drive has none.
 * @param {Record<string, any>} courses by version of the study
 * @param {number | null} version
 * @param {any} drive or null
 * @returns {import("../../study/course.js").Marks | null}
 */
export const courseOf = (courses, version, drive) => {
  const course = courses[drive?.version ?? version];
  if (!course || (drive && !drive.task)) {
    return null;
  }
  const marks = marksFor(course, drive ? { ...TASK, ...drive.task } : null);
  return marks && !drive
    ? { ...marks, stops: marks.stops.map((stop) => ({ ...stop, status: "later" })) }
    : marks;
};

/**
 * The localized positions.
 * @param {{x: number[], y: number[], localized: number[]}} states columns of a record
 * @returns {Point[]} m
 */
export const trailOf = ({ x, y, localized }) =>
  x.flatMap((each, i) => (localized[i] ? [/** @type {Point} */ ([each, y[i]])] : []));
