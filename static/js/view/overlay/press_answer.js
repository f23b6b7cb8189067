/** What a press on the floor leads to, and its answer where it leads nowhere. Pure. */

import { reasonFor } from "../../autonomy/reasons.js";

const AT = 0.3; // m from the point: there
const LEAST_DISTANCE = 0.3; // m to a place that is worth driving to
const DETOUR = { times: 2, more: 2 }; // of the distance, m: the robot asks before it drives farther
/** Reasons that say no more than that the robot cannot stand there. */
const TAKEN = /^(in_wall|goal_taken|too_narrow)\b/;

/**
 * @typedef {{no: string, point?: Point, at?: Place, hidden?: boolean} | {turn: Point}
 *   | {goal: Point, sweptPath: SweptPath, cut?: boolean, point?: Point}} Target of a press; `cut`:
 *   the goal is before an obstacle, and not at the `point`; `hidden`: the point is the foot of what
 *   hides the floor that was pressed
 * @typedef {import("../../protocol/route_preview.js").Preview} Preview
 * @typedef {{go: Point} | {straight: Point}
 *   | {word: string, values?: Record<string, string>, goal: Point | null}} Answer `go` by the
 *   robot's own navigation; `goal`: where it can go instead
 */

/** @param {Point} one @param {Point} other */
const apart = (one, other) => Math.hypot(one[0] - other[0], one[1] - other[1]);

/** @param {Point[]} points */
const lengthOf = (points) =>
  points.slice(1).reduce((sum, point, i) => sum + apart(point, points[i]), 0);

/**
 * @param {Exclude<Target, {turn: Point}>} target that is not reached straight ahead
 * @param {Preview | null} found null without an answer of the robot
 * @param {Place} robot
 * @returns {Answer}
 */
export const answerTo = (target, found, robot) => {
  const here = /** @type {Point} */ ([robot.x, robot.y]);
  const end = found?.points.at(-1) ?? null;
  const { point } = target;
  if (found && end && point && !("hidden" in target) && apart(end, point) <= AT) {
    const isNear = lengthOf(found.points) <= DETOUR.times * apart(here, point) + DETOUR.more;
    return isNear ? { go: end } : { word: "point.around", goal: end };
  }
  if ("goal" in target) {
    return { straight: target.goal };
  }
  const goal = end && apart(here, end) > LEAST_DISTANCE ? end : null;
  const reason = found && !TAKEN.test(found.reason) ? reasonFor(found.reason) : null;
  const word = goal ? "point.beside" : end ? "point.nearest" : `point.${target.no}`;
  return { ...(reason ?? { word }), goal };
};
