/**
 * The course on the map: zones and the suggested path below everything, the checkpoints over the
 * driven path. The next checkpoint, passed ones and later ones differ by shape, not only by colour.
 */

import { disc, fill, label, stroke, trace } from "../lib/canvas.js";
import { toScreen } from "../view/map/transform.js";
import { stopsOf } from "./guide.js";

const SIZE = 10; // CSS pixels, the radius of a checkpoint's disc
const NEXT_SIZE = 14;

/**
 * @typedef {{zones: Point[][], path: Point[],
 *   stops: (import("./guide.js").Stop & {x: number, y: number, radius: number})[]}} Marks
 */

/**
 * Pure.
 * @param {any} study @param {import("./guide.js").Progress | null} progress @returns {Marks | null}
 */
export const marksFor = (study, progress) => {
  if (!study?.checkpoints.length) {
    return null;
  }
  const place = new Map(study.checkpoints.map((/** @type {any} */ stop) => [stop.number, stop]));
  // The station's docked pose: its checkpoint may lie a little beside it.
  place.set(0, { ...place.get(0), ...study.dock });
  const stops = stopsOf(study, progress).map((stop) => ({ ...place.get(stop.number), ...stop }));
  const zones = study.zones.map((/** @type {any} */ zone) => zone.polygon);
  return { zones, path: study.path, stops };
};

/**
 * What draws a course on a RobotMap.
 * @param {Marks | null} marks @returns {import("../view/map/robot_map.js").RobotMap["course"]}
 */
export const layersOf = (marks) =>
  marks && {
    below: (context, view, paint) => drawGround(context, view, marks, paint),
    above: (context, view, paint) => drawStops(context, view, marks, paint),
  };

/** @param {Canvas2D} context @param {MapView} view @param {Marks} marks @param {Paint} paint */
const drawGround = (context, view, { zones, path }, paint) => {
  context.save();
  const points = (/** @type {Point[]} */ line) => line.map(([x, y]) => toScreen(view, x, y));
  for (const zone of zones) {
    trace(context, points(zone));
    context.closePath();
    stroke(context, paint.zone, 1, [2, 4]);
  }
  context.globalAlpha = 0.55;
  trace(context, points(path));
  stroke(context, paint.route, 2, [1, 7]);
  context.restore();
};

/** @param {Canvas2D} context @param {MapView} view @param {Marks} marks @param {Paint} paint */
const drawStops = (context, view, { stops }, paint) => {
  context.save();
  const isNext = (/** @type {Marks["stops"][number]} */ { status }) => status === "next";
  // the next one last, so that no other covers it
  for (const stop of [...stops.filter((one) => !isNext(one)), ...stops.filter(isNext)]) {
    drawStop(context, view, stop, paint);
  }
  context.restore();
};

/**
 * @param {Canvas2D} context @param {MapView} view
 * @param {Marks["stops"][number]} stop @param {Paint} paint
 */
const drawStop = (context, view, { x, y, radius, number, status }, paint) => {
  const [px, py] = toScreen(view, x, y);
  const isNext = status === "next";
  const size = isNext ? NEXT_SIZE : SIZE;
  if (isNext) {
    disc(context, px, py, Math.max(size + 4, radius * view.scale));
    fill(context, paint.next, 0.22);
    stroke(context, paint.next, 2);
  }
  if (number === 0) {
    return; // the plan has its sign
  }
  const colour = isNext ? paint.edge : status === "passed" ? paint.passed : paint.name;
  disc(context, px, py, size);
  fill(context, isNext ? paint.next : paint.edge);
  stroke(context, colour, 2);
  context.font = `700 ${isNext ? 16 : 12}px ${paint.font.split("px ")[1]}`;
  label(context, status === "passed" ? "✓" : String(number), px, py + 0.5, colour);
};
