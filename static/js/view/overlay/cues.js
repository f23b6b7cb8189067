/** The places that are marked in the video: the target of the cue, and the dock. Pure. */

import { stationOf } from "../../autonomy/map_bar.js";
import { isMoving } from "../../protocol/robot_action.js";
import { targetOf } from "../../study/guide.js";
import { hidesWall } from "./visibility.js";

const STATION_WITHIN = 6; // m: without a task, a visible dock is marked
const USUAL_RADIUS = 0.3; // m

/** @param {State} state @param {Moment} moment @returns {import("./drawing.js").Cue[]} */
export const cuesFor = (state, moment) => {
  if (!moment.localized || state.robot?.docked) {
    return [];
  }
  const target = targetOf(state);
  if (target) {
    const { checkpoints = [] } = state.study ?? {};
    const stop = checkpoints.find((/** @type {any} */ { number }) => number === target.number);
    const sign = target.number ? String(target.number) : "";
    return [cue(state, moment, target, stop?.radius ?? USUAL_RADIUS, sign)];
  }
  const station = state.study ? null : stationOf(state);
  const wanted = isMoving(state.task) && state.task?.type === "dock";
  const marked = station && cue(state, moment, station, USUAL_RADIUS, "");
  return marked &&
    (wanted ||
      (!marked.hidden && Math.hypot(station.x - moment.x, station.y - moment.y) < STATION_WITHIN))
    ? [marked]
    : [];
};

/**
 * @param {State} state @param {Moment} moment
 * @param {{x: number, y: number}} place @param {number} radius @param {string} sign
 */
const cue = ({ plan }, moment, { x, y }, radius, sign) => ({
  point: /** @type {Point} */ ([x, y]),
  radius,
  sign,
  hidden: hidesWall(plan, [moment.x, moment.y], [x, y]),
});
