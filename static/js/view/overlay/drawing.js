/**
 * Draws on the video: the floor that the robot will sweep, its goal, the next checkpoint and the
 * dock. Lines are thin, so that they hide nothing; near obstacles make them wider, not only another
 * colour.
 */

import { bolt, disc, fill, label, stroke, strokeWithEdge, trace } from "../../lib/canvas.js";
import { mapFromRobot, robotFromMap } from "../../lib/transforms.js";
import { depthOf, toElement, toPicture } from "./camera_model.js";
import { CLOSE, NEAR } from "../../lib/swept_path.js";

/**
 * @typedef {{camera: import("./camera_model.js").Camera, moment: Moment,
 *   box: import("./camera_model.js").Box}} Eye the camera of the frame
 * @typedef {{point: Point, radius: number, sign: string, hidden: boolean}} Cue a place: its number,
 *   or empty for the dock
 * @typedef {{sweptPath: SweptPath | null, committed: boolean, goal: Point | null,
 *   blocked: Place | null, cross: Point | null, footprint: Point[], radius: number,
 *   cues: Cue[]}} Scene `blocked`: where the robot would touch an obstacle; `cross`: the pressed
 *   point, CSS pixels, that it cannot reach
 */

const LEAST_DEPTH = 0.1; // m before the lens
const POST = 0.45; // m: the height of a cue's sign
const SIGN = 13; // CSS pixels
const CROSS = 9; // CSS pixels from its middle to a tip; the ring about it is a finger wide

/**
 * @param {Canvas2D} context in CSS pixels
 * @param {Eye} eye @param {Scene} scene @param {Paint} paint
 */
export const drawScene = (
  context,
  eye,
  { sweptPath, committed, goal, blocked, cross, footprint, radius, cues },
  paint,
) => {
  context.lineJoin = "round";
  context.lineCap = "round";
  if (sweptPath) {
    drawSweptPath(context, eye, sweptPath, committed, paint);
  }
  if (blocked) {
    drawBlocked(context, eye, blocked, footprint, paint);
  }
  cues.forEach((cue) => drawCue(context, eye, cue, paint));
  if (goal) {
    for (const size of [radius, radius / 6]) {
      ring(context, eye, goal, size);
      strokeWithEdge(context, paint.goal, 3, paint.edge);
    }
  }
  if (cross) {
    drawCross(context, cross, paint);
  }
};

/** @param {Canvas2D} context @param {Point} at CSS pixels @param {Paint} paint */
const drawCross = (context, [px, py], paint) => {
  disc(context, px, py, 2.4 * CROSS);
  context.moveTo(px - CROSS, py - CROSS);
  context.lineTo(px + CROSS, py + CROSS);
  context.moveTo(px - CROSS, py + CROSS);
  context.lineTo(px + CROSS, py - CROSS);
  strokeWithEdge(context, paint.close, 4, paint.edge);
};

/**
 * @param {Eye} eye
 * @param {Point} point of the map
 * @param {number} [up] m
 * @returns {Point | null} null behind the lens
 */
const place = ({ camera, moment, box }, point, up = 0) => {
  const spot = /** @type {[number, number, number]} */ ([...robotFromMap(moment, point), up]);
  return depthOf(camera, moment.tilt, spot) < LEAST_DEPTH
    ? null
    : toElement(box, toPicture(camera, moment.tilt, spot));
};

/**
 * The part of a segment that is before the lens.
 * @param {Eye} eye @param {Point} a @param {Point} b
 */
const edge = (eye, a, b) => {
  const [one, other] = [a, b].map(
    (point) => depthOf(eye.camera, eye.moment.tilt, robotFromMap(eye.moment, point)) - LEAST_DEPTH,
  );
  if (one < 0 && other < 0) {
    return null;
  }
  const at = one / (one - other);
  const between = /** @type {Point} */ ([a[0] + at * (b[0] - a[0]), a[1] + at * (b[1] - a[1])]);
  const ends = [one < 0 ? between : a, other < 0 ? between : b].map((point) =>
    toElement(eye.box, toPicture(eye.camera, eye.moment.tilt, robotFromMap(eye.moment, point))),
  );
  return /** @type {[Point, Point]} */ (ends);
};

/** @param {number} clearance m */
const toneOf = (clearance) => (clearance < CLOSE ? "close" : clearance < NEAR ? "near" : "free");
/** @type {Record<string, number>} */
const WIDTHS = { free: 2.5, near: 3.5, close: 5, committed: 3 };

/**
 * @param {Canvas2D} context @param {Eye} eye @param {SweptPath} sweptPath
 * @param {boolean} committed @param {Paint} paint
 */
const drawSweptPath = (context, eye, { slices, blocked }, committed, paint) => {
  slices.slice(1).forEach((slice, i) => {
    const tone = committed ? "committed" : toneOf(Math.min(slice.clearance, slices[i].clearance));
    const [left, right] = [
      edge(eye, slices[i].left, slice.left),
      edge(eye, slices[i].right, slice.right),
    ];
    if (left && right) {
      trace(context, [left[0], left[1], right[1], right[0]]);
      fill(context, paint[tone], 0.2);
    }
    for (const line of [left, right]) {
      trace(context, line ?? []);
      stroke(context, paint[tone], WIDTHS[tone]);
    }
  });
  const last = slices.at(-1);
  if (blocked && last) {
    trace(context, edge(eye, last.left, last.right) ?? []);
    strokeWithEdge(context, paint.close, 7, paint.edge);
  }
};

/**
 * The robot's outline where it would touch an obstacle.
 * @param {Canvas2D} context @param {Eye} eye @param {Place} at
 * @param {Point[]} footprint @param {Paint} paint
 */
const drawBlocked = (context, eye, at, footprint, paint) => {
  const corners = footprint.map((corner) => place(eye, mapFromRobot(at, corner)));
  if (corners.some((corner) => corner === null)) {
    return; // under the camera
  }
  trace(context, /** @type {Point[]} */ ([...corners, corners[0]]));
  fill(context, paint.close, 0.35);
  strokeWithEdge(context, paint.close, 4, paint.edge);
};

/**
 * A circle on the floor.
 * @param {Canvas2D} context @param {Eye} eye @param {Point} middle
 * @param {number} radius m
 */
const ring = (context, eye, [x, y], radius) => {
  const points = Array.from({ length: 33 }, (_, i) =>
    place(eye, [
      x + radius * Math.cos((i * Math.PI) / 16),
      y + radius * Math.sin((i * Math.PI) / 16),
    ]),
  );
  trace(context, points.every((point) => point !== null) ? /** @type {Point[]} */ (points) : []);
};

/** The middle of a cue's sign. @param {Eye} eye @param {Point} point of the map */
export const signOf = (eye, point) => place(eye, point, POST);

/** @param {Canvas2D} context @param {Eye} eye @param {Cue} cue @param {Paint} paint */
const drawCue = (context, eye, { point, radius, sign, hidden }, paint) => {
  const [foot, head] = [place(eye, point), signOf(eye, point)];
  if (!foot || !head) {
    return;
  }
  if (!hidden) {
    ring(context, eye, point, radius);
    strokeWithEdge(context, paint.next, 3, paint.edge);
    trace(context, [foot, head]);
    strokeWithEdge(context, paint.next, 2, paint.edge);
  }
  const [ground, colour] = hidden ? [paint.edge, paint.next] : [paint.next, paint.edge];
  const alpha = hidden ? 0.75 : 1;
  disc(context, ...head, SIGN);
  fill(context, ground, alpha);
  stroke(context, colour, 2);
  if (sign) {
    context.font = paint.font;
    label(context, sign, head[0], head[1] + 0.5, colour);
  } else {
    bolt(context, ...head, 7);
    fill(context, colour, alpha);
  }
};
