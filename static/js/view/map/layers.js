/**
 * Drawings over the floor plan besides the robot: laser points, the uncertainty of its pose,
 * its goal, and the obstacle that assistance reacts to. The geometry is pure.
 */

import { disc, fill, stroke } from "../../lib/canvas.js";
import { mapFromRobot } from "../../lib/transforms.js";
import { toScreen } from "./transform.js";

/** @typedef {{kind: "goal" | "pose", x: number, y: number, theta: number | null}} Aim */

const SIGMAS = 2;
const LEAST_ELLIPSE = 4; // CSS pixels; a smaller one is hidden by the marker

/**
 * The points of a sweep, in the map.
 * @param {{angleMin: number, angleIncrement: number, rangeMax: number, ranges: (number | null)[]}}
 *   scan
 * @param {{x: number, y?: number, theta?: number}} mount of the laser, in the robot's frame
 * @param {Place} pose of the robot
 * @returns {Point[]}
 */
export const scanPoints = (
  { angleMin, angleIncrement, rangeMax, ranges },
  { x, y = 0, theta = 0 },
  pose,
) => {
  const [laserX, laserY] = mapFromRobot(pose, [x, y]);
  const laser = { x: laserX, y: laserY, theta: pose.theta + theta };
  return ranges.flatMap((range, i) => {
    const angle = angleMin + i * angleIncrement;
    return range === null || range >= rangeMax
      ? []
      : [mapFromRobot(laser, [range * Math.cos(angle), range * Math.sin(angle)])];
  });
};

/**
 * The ellipse that contains the robot's position with a probability of about 86 %: the eigenvectors
 * of the covariance, two standard deviations long.
 * @param {number[] | null | undefined} covariance xx, xy, xθ, yy, yθ, θθ
 * @returns {{along: number, across: number, turn: number} | null} half axes in m, and where the
 *   longer one points in rad
 */
export const ellipseOf = (covariance) => {
  if (!covariance) {
    return null;
  }
  const [xx, xy, , yy] = covariance;
  const middle = (xx + yy) / 2;
  const spread = Math.hypot((xx - yy) / 2, xy);
  const axis = (/** @type {number} */ variance) => SIGMAS * Math.sqrt(Math.max(0, variance));
  return {
    along: axis(middle + spread),
    across: axis(middle - spread),
    turn: Math.atan2(2 * xy, xx - yy) / 2,
  };
};

/**
 * @param {Canvas2D} context @param {MapView} view @param {Point[]} points @param {string} colour
 */
export const drawPoints = (context, view, points, colour) => {
  context.fillStyle = colour;
  for (const [x, y] of points) {
    const [px, py] = toScreen(view, x, y);
    context.fillRect(px - 1, py - 1, 2, 2);
  }
};

/**
 * @param {Canvas2D} context @param {MapView} view
 * @param {Place & {covariance?: number[] | null}} pose @param {string} colour
 */
export const drawUncertainty = (context, view, pose, colour) => {
  const ellipse = ellipseOf(pose.covariance);
  if (!ellipse || ellipse.along * view.scale < LEAST_ELLIPSE) {
    return;
  }
  context.save();
  context.beginPath();
  context.ellipse(
    ...toScreen(view, pose.x, pose.y),
    ellipse.along * view.scale,
    Math.max(1, ellipse.across * view.scale),
    -ellipse.turn - (view.turn ?? 0),
    0,
    2 * Math.PI,
  );
  fill(context, colour, 0.16);
  context.globalAlpha = 0.5;
  stroke(context, colour, 1);
  context.restore();
};

/**
 * A ring with a dot, and an arrow for the heading.
 * @param {Canvas2D} context @param {MapView} view @param {Aim} aim
 * @param {string} colour @param {string} edge
 */
export const drawAim = (context, view, { x, y, theta }, colour, edge) => {
  const [px, py] = toScreen(view, x, y);
  disc(context, px, py, 9);
  if (theta !== null) {
    const heading = theta + (view.turn ?? 0);
    const [cos, sin] = [Math.cos(heading), -Math.sin(heading)];
    const tip = [px + 26 * cos, py + 26 * sin];
    context.moveTo(px + 9 * cos, py + 9 * sin);
    context.lineTo(tip[0], tip[1]);
    context.moveTo(tip[0] - 8 * cos + 6 * sin, tip[1] - 8 * sin - 6 * cos);
    context.lineTo(tip[0], tip[1]);
    context.lineTo(tip[0] - 8 * cos - 6 * sin, tip[1] - 8 * sin + 6 * cos);
  }
  stroke(context, edge, 6);
  stroke(context, colour, 3);
  disc(context, px, py, 3);
  fill(context, colour);
};

/**
 * The obstacle that assistance reacts to: a cross in a ring, not marked by colour alone.
 * @param {Canvas2D} context @param {MapView} view
 * @param {Point} point of the map
 * @param {string} colour
 */
export const drawObstacle = (context, view, [x, y], colour) => {
  const [px, py] = toScreen(view, x, y);
  disc(context, px, py, 6);
  context.moveTo(px - 3, py - 3);
  context.lineTo(px + 3, py + 3);
  context.moveTo(px - 3, py + 3);
  context.lineTo(px + 3, py - 3);
  stroke(context, colour, 2);
};
