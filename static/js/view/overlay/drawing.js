/**
 * Draws on the picture: the floor that the robot will sweep, where it will come to, and where the
 * next checkpoint and the dock are. Thin and clear, so that nothing hides the way; what is near
 * differs by the width of its line and not by its colour alone.
 */

import { mapFromRobot, robotFromMap } from "../../lib/transforms.js";
import { depthOf, toElement, toPicture } from "./camera_model.js";
import { CLOSE, NEAR } from "../../lib/swept_path.js";

/**
 * @typedef {{camera: import("./camera_model.js").Camera, moment: Moment,
 *   box: import("./camera_model.js").Box}} Eye whose picture it is
 */
/**
 * @typedef {{point: Point, radius: number, sign: string, hidden: boolean}} Cue a place:
 *   its number, or nothing for the dock
 */
/**
 * @typedef {{sweptPath: SweptPath | null, committed: boolean,
 *   goal: Point | null, blocked: Place | null,
 *   footprint: Point[], radius: number, cues: Cue[]}} Scene `blocked`: where the robot
 *   would touch something
 */

const LEAST_DEPTH = 0.1; // m before the lens
const POST = 0.45; // m: how high a cue's sign stands
const SIGN = 13; // CSS pixels

/**
 * @param {Canvas2D} context in CSS pixels
 * @param {Eye} eye @param {Scene} scene @param {Paint} paint
 */
export const drawScene = (
  context,
  eye,
  { sweptPath, committed, goal, blocked, footprint, radius, cues },
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
    ring(context, eye, goal, radius);
    stroke(context, 3, paint.goal, paint.edge);
    ring(context, eye, goal, radius / 6);
    stroke(context, 3, paint.goal, paint.edge);
  }
};

/**
 * @param {Eye} eye
 * @param {Point} point of the map
 * @param {number} [up] m
 * @returns {Point | null} null for what is not before the lens
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
const WIDTHS = /** @type {Record<string, number>} */ ({
  free: 2.5,
  near: 3.5,
  close: 5,
  committed: 3,
});

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
      context.beginPath();
      [left[0], left[1], right[1], right[0]].forEach((point) => context.lineTo(...point));
      context.globalAlpha = 0.2;
      context.fillStyle = paint[tone];
      context.fill();
      context.globalAlpha = 1;
    }
    for (const line of [left, right]) {
      trace(context, line ?? []);
      context.lineWidth = WIDTHS[tone];
      context.strokeStyle = paint[tone];
      context.stroke();
    }
  });
  const last = slices.at(-1);
  if (blocked && last) {
    trace(context, edge(eye, last.left, last.right) ?? []);
    stroke(context, 7, paint.close, paint.edge);
  }
};

/**
 * The robot's outline where it would touch something.
 * @param {Canvas2D} context @param {Eye} eye @param {Place} at
 * @param {Point[]} footprint @param {Paint} paint
 */
const drawBlocked = (context, eye, at, footprint, paint) => {
  const corners = footprint.map((corner) => place(eye, mapFromRobot(at, corner)));
  if (corners.some((corner) => corner === null)) {
    return; // under the camera
  }
  trace(context, /** @type {Point[]} */ ([...corners, corners[0]]));
  context.globalAlpha = 0.35;
  context.fillStyle = paint.close;
  context.fill();
  context.globalAlpha = 1;
  stroke(context, 4, paint.close, paint.edge);
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

/** @param {Canvas2D} context @param {Eye} eye @param {Cue} cue @param {Paint} paint */
const drawCue = (context, eye, { point, radius, sign, hidden }, paint) => {
  const [foot, head] = [place(eye, point), place(eye, point, POST)];
  if (!foot || !head) {
    return;
  }
  context.globalAlpha = hidden ? 0.75 : 1;
  if (!hidden) {
    ring(context, eye, point, radius);
    stroke(context, 3, paint.next, paint.edge);
    trace(context, [foot, head]);
    stroke(context, 2, paint.next, paint.edge);
  }
  context.beginPath();
  context.arc(head[0], head[1], SIGN, 0, 2 * Math.PI);
  context.fillStyle = hidden ? paint.edge : paint.next;
  context.fill();
  context.lineWidth = 2;
  context.strokeStyle = hidden ? paint.next : paint.edge;
  context.stroke();
  context.fillStyle = hidden ? paint.next : paint.edge;
  context.font = paint.font;
  context.textAlign = "center";
  context.textBaseline = "middle";
  if (sign) {
    context.fillText(sign, head[0], head[1] + 0.5);
  } else {
    bolt(context, head[0], head[1], 7);
    context.fill();
  }
  context.globalAlpha = 1;
};

/**
 * The sign of charging.
 * @param {Canvas2D} context @param {number} x @param {number} y @param {number} size
 */
const bolt = (context, x, y, size) => {
  const corners = [
    [0.2, -1.3],
    [-0.8, 0.2],
    [-0.05, 0.2],
    [-0.2, 1.3],
    [0.8, -0.2],
    [0.05, -0.2],
  ];
  trace(
    context,
    corners.map(([u, v]) => [x + u * size, y + v * size]),
  );
};

/** @param {Canvas2D} context @param {Point[]} points */
const trace = (context, points) => {
  context.beginPath();
  points.forEach((point) => context.lineTo(...point));
};

/**
 * A line that is readable on any floor.
 * @param {Canvas2D} context @param {number} width @param {string} colour @param {string} around
 */
const stroke = (context, width, colour, around) => {
  for (const [wide, style] of /** @type {[number, string][]} */ ([
    [width + 2.5, around],
    [width, colour],
  ])) {
    context.lineWidth = wide;
    context.strokeStyle = style;
    context.stroke();
  }
};
