/**
 * The floor that the robot will sweep: its footprint moved from place to place, cut at the first
 * obstacle. Pure.
 *
 * On a stretch of curvature k the robot turns about the point (0, 1/k) of its own frame. Every
 * point of the footprint keeps its distance from there, so the robot sweeps the ring between the
 * least and the greatest of these distances: exact, however sharp the turn.
 */

import { along, mapFromRobot } from "./transforms.js";

/**
 * @typedef {Place & {curvature: number}} Step a place of the robot's centre, and 1/m
 * @typedef {{left: Point, right: Point, clearance: number}} Slice across the path: its ends and the
 *   room beside it, m
 * @typedef {{slices: Slice[], blocked: boolean, end: Step, length: number}} SweptPath where the
 *   robot's centre gets to, and after how many m
 */

export const CLOSE = 0.2; // m beside the robot: a touch is near
export const NEAR = 0.5; // m beside the robot
const STRAIGHT = 1e-3; // 1/m
const FREE = 2; // m beside the path: no obstacle is near
const PIECE = 0.1; // m from one place to the next
const TICK = 0.02; // s; every fifth is drawn
const LEAST = 0.05; // m; less is no path
const CREEP = 0.03; // m/s; slower is standing, or turning on the spot, which sweeps no path

/**
 * How far the footprint reaches to the left and to the right of the path of the robot's centre.
 * @param {Point[]} footprint m, robot's frame, convex
 * @param {number} curvature 1/m, positive turns left
 * @returns {Point} m, both positive
 */
export const reachOf = (footprint, curvature) => {
  const straight = /** @type {Point} */ ([
    Math.max(...footprint.map(([, y]) => y)),
    Math.max(...footprint.map(([, y]) => -y)),
  ]);
  if (Math.abs(curvature) < STRAIGHT) {
    return straight;
  }
  const radius = 1 / curvature;
  const away = Math.abs(radius);
  const far = Math.max(...footprint.map(([x, y]) => Math.hypot(x, y - radius)));
  const isInside = away < straight[curvature > 0 ? 0 : 1];
  const near = isInside
    ? 0
    : Math.min(
        ...footprint.map((corner, i) =>
          distanceTo([0, radius], corner, footprint[(i + 1) % footprint.length]),
        ),
      );
  return curvature > 0 ? [away - near, far - away] : [far - away, away - near];
};

/** From a point to a segment, in m. @param {Point} point @param {Point} start @param {Point} end */
export const distanceTo = ([x, y], [ax, ay], [bx, by]) => {
  const [dx, dy] = [bx - ax, by - ay];
  const share = Math.max(
    0,
    Math.min(1, ((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy || 1)),
  );
  return Math.hypot(x - ax - share * dx, y - ay - share * dy);
};

/**
 * @param {Place} start @param {number} curvature
 * @param {number} length m, negative is backwards
 * @returns {Step[]}
 */
export const arcSteps = (start, curvature, length) => {
  const count = Math.max(1, Math.ceil(Math.abs(length) / PIECE));
  return Array.from({ length: count + 1 }, (_, i) => ({
    ...along(start, length, length * curvature, i / count),
    curvature,
  }));
};

/**
 * What holding a command does: the speeds rise and fall as the robot's limits allow.
 * @param {Moment} start
 * @param {{linear: number, angular: number}} command m/s, rad/s
 * @param {{linearAcceleration: number, linearBraking: number, angularAcceleration: number,
 *   angularBraking: number}} limits
 * @param {number} seconds
 * @returns {Step[]} none for a robot that stands or turns on the spot
 */
export const heldSteps = (start, command, limits, seconds) => {
  let place = /** @type {Place} */ (start);
  let { linear, angular } = start;
  const steps = /** @type {Step[]} */ ([]);
  for (let tick = 0; tick * TICK < seconds; tick += 1) {
    linear = approach(linear, command.linear, limits.linearAcceleration, limits.linearBraking);
    angular = approach(angular, command.angular, limits.angularAcceleration, limits.angularBraking);
    const { x, y, theta } = place;
    if (tick % 5 === 0) {
      steps.push({ x, y, theta, curvature: Math.abs(linear) < CREEP ? 0 : angular / linear });
    }
    place = along(place, linear, angular, TICK);
  }
  const last = {
    x: place.x,
    y: place.y,
    theta: place.theta,
    curvature: steps.at(-1)?.curvature ?? 0,
  };
  return Math.hypot(last.x - start.x, last.y - start.y) < LEAST ? [] : [...steps, last];
};

/**
 * The speed after a tick. Where its sign changes, it is zero first.
 * @param {number} now @param {number} wanted
 * @param {number} rise @param {number} fall m/s² or rad/s²
 */
const approach = (now, wanted, rise, fall) => {
  const aim = wanted * now < 0 ? 0 : wanted;
  const most = TICK * (Math.abs(aim) < Math.abs(now) ? fall : rise);
  return now + Math.max(-most, Math.min(most, aim - now));
};

/**
 * A line of the map that the robot follows by itself, from where it is.
 * @param {Place} robot @param {Point[]} points @returns {Step[]}
 */
export const lineSteps = (robot, points) => {
  const distances = points.map(([x, y]) => Math.hypot(x - robot.x, y - robot.y));
  const ahead = points.slice(distances.indexOf(Math.min(...distances)) + 1);
  return ahead.map(([x, y], i) => {
    const [fromX, fromY] = i === 0 ? [robot.x, robot.y] : ahead[i - 1];
    return { x, y, theta: Math.atan2(y - fromY, x - fromX), curvature: 0 };
  });
};

/**
 * @param {Step[]} steps of one path, forwards or backwards
 * @param {Point[]} footprint
 * @param {Point[]} seen by the laser, in the frame of the steps
 * @param {number} sign -1 for a path backwards
 * @returns {SweptPath | null} null without a path; it ends before an obstacle
 */
export const sweep = (steps, footprint, seen, sign = 1) => {
  const nose = Math.max(...footprint.map(([x]) => sign * x));
  const slices = /** @type {Slice[]} */ ([]);
  let [blocked, length, end] = [false, 0, steps[0]];
  for (const step of steps) {
    const [left, right] = reachOf(footprint, step.curvature);
    let clearance = FREE;
    const [cos, sin] = [Math.cos(step.theta), Math.sin(step.theta)];
    for (const [px, py] of seen) {
      // The robot's frame, without a list a point: there are thousands.
      const [dx, dy] = [px - step.x, py - step.y];
      const x = dx * cos + dy * sin;
      const y = dy * cos - dx * sin;
      const beside = Math.max(y - left, -right - y);
      if (Math.abs(x) <= nose) {
        clearance = Math.min(clearance, Math.max(0, beside));
      }
      blocked ||= beside < 0 && sign * x > 0 && sign * x <= nose;
    }
    slices.push({
      left: mapFromRobot(step, [0, left]),
      right: mapFromRobot(step, [0, -right]),
      clearance: blocked ? 0 : clearance,
    });
    if (blocked) {
      break;
    }
    length += Math.hypot(step.x - end.x, step.y - end.y);
    end = step;
  }
  if (slices.length < 2) {
    return steps.length ? { slices: [], blocked, end, length } : null;
  }
  if (!blocked) {
    const [left, right] = reachOf(footprint, 0);
    slices.push({
      left: mapFromRobot(end, [sign * nose, left]),
      right: mapFromRobot(end, [sign * nose, -right]),
      clearance: slices.at(-1)?.clearance ?? FREE,
    });
  }
  return { slices, blocked, end, length };
};
