/**
 * The course on the map: zones and the suggested way faintly beneath everything, the checkpoints
 * over the path that was driven. What is next, passed or still to come differs by its shape, and
 * not by its colour alone.
 */

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
 * @param {any} study @param {import("./guide.js").Told | null} told @returns {Marks | null}
 */
export const marksFor = (study, told) => {
  if (!study?.checkpoints.length) {
    return null;
  }
  const place = new Map(study.checkpoints.map((/** @type {any} */ stop) => [stop.number, stop]));
  // The station's docked pose: its checkpoint may lie a little beside it.
  place.set(0, { ...place.get(0), ...study.dock });
  const stops = stopsOf(study, told).map((stop) => ({ ...place.get(stop.number), ...stop }));
  return {
    zones: study.zones.map((/** @type {any} */ zone) => zone.polygon),
    path: study.path,
    stops,
  };
};

/** @param {Canvas2D} context @param {MapView} view @param {Marks} marks @param {Paint} paint */
export const drawGround = (context, view, { zones, path }, paint) => {
  context.save();
  context.lineWidth = 1;
  context.strokeStyle = paint.zone;
  context.setLineDash([2, 4]);
  for (const zone of zones) {
    trace(context, view, zone);
    context.closePath();
    context.stroke();
  }
  context.globalAlpha = 0.55;
  context.lineWidth = 2;
  context.strokeStyle = paint.route;
  context.setLineDash([1, 7]);
  trace(context, view, path);
  context.stroke();
  context.restore();
};

/** @param {Canvas2D} context @param {MapView} view @param {Marks} marks @param {Paint} paint */
export const drawStops = (context, view, { stops }, paint) => {
  context.save();
  // What is next is drawn last: nothing lies over it.
  for (const stop of [...stops].sort(
    (one, other) => Number(one.status === "next") - Number(other.status === "next"),
  )) {
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
    context.globalAlpha = 0.22;
    context.fillStyle = paint.next;
    context.fill();
    context.globalAlpha = 1;
    context.lineWidth = 2;
    context.strokeStyle = paint.next;
    context.stroke();
  }
  if (number === 0) {
    return; // the plan has its sign
  }
  disc(context, px, py, size);
  context.fillStyle = isNext ? paint.next : paint.edge;
  context.fill();
  context.lineWidth = 2;
  context.strokeStyle = isNext ? paint.edge : status === "passed" ? paint.passed : paint.name;
  context.stroke();
  context.font = `700 ${isNext ? 16 : 12}px ${paint.font.split("px ")[1]}`;
  context.fillStyle = isNext ? paint.edge : status === "passed" ? paint.passed : paint.name;
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.fillText(status === "passed" ? "✓" : String(number), px, py + 0.5);
};

/** @param {Canvas2D} context @param {number} x @param {number} y @param {number} radius */
const disc = (context, x, y, radius) => {
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
};

/** @param {Canvas2D} context @param {MapView} view @param {Point[]} points */
const trace = (context, view, points) => {
  context.beginPath();
  for (const [x, y] of points) {
    context.lineTo(...toScreen(view, x, y));
  }
};
