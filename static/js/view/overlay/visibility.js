/** Which points are behind walls. Pure: by the floor plan, and by the last sweep of the laser. */

const BEHIND = 0.15; // m: a point nearer to an obstacle is at its foot

/**
 * How far the nearest wall of the plan is between two points. A doorway is a hole, also with its
 * door closed.
 * @param {any} plan @param {Point} from @param {Point} to @returns {number} m; infinite without one
 */
export const wallBefore = (plan, from, to) => {
  const holes = [...(plan?.doors ?? []), ...(plan?.passages ?? [])];
  const crossings = (plan?.walls ?? []).map((/** @type {any} */ { start, end }) => {
    const at = crossing(from, to, start, end);
    return at === null || holes.some((hole) => isOn(at, hole.start, hole.end))
      ? Infinity
      : Math.hypot(at[0] - from[0], at[1] - from[1]);
  });
  return Math.min(Infinity, ...crossings);
};

/**
 * Whether a wall of the plan is between two points.
 * @param {any} plan @param {Point} from @param {Point} to
 */
export const hidesWall = (plan, from, to) => wallBefore(plan, from, to) < Infinity;

/**
 * Where two segments cross.
 * @param {Point} a @param {Point} b @param {Point} c @param {Point} d @returns {Point | null}
 */
const crossing = ([ax, ay], [bx, by], [cx, cy], [dx, dy]) => {
  const [ux, uy, vx, vy] = [bx - ax, by - ay, dx - cx, dy - cy];
  const cross = ux * vy - uy * vx;
  const [wx, wy] = [cx - ax, cy - ay];
  const [s, t] = [(wx * vy - wy * vx) / cross, (wx * uy - wy * ux) / cross];
  return s > 0 && s < 1 && t >= 0 && t <= 1 ? [ax + s * ux, ay + s * uy] : null;
};

/** @param {Point} point @param {Point} start @param {Point} end */
const isOn = ([x, y], [ax, ay], [bx, by]) => {
  const length = Math.hypot(bx - ax, by - ay);
  const [dx, dy] = [(bx - ax) / length, (by - ay) / length];
  const [at, aside] = [(x - ax) * dx + (y - ay) * dy, (y - ay) * dx - (x - ax) * dy];
  return at >= 0 && at <= length && Math.abs(aside) < 0.3;
};

/**
 * How far away the laser met something before a point, in its direction.
 * @param {Point[]} seen m, robot's frame @param {Point} point m, robot's frame
 * @returns {number} m; infinite without an obstacle
 */
export const obstacleBefore = (seen, point) => {
  const [bearing, distance] = [Math.atan2(point[1], point[0]), Math.hypot(...point)];
  // A little beside the line is still on it: beams are apart, by a degree or two.
  const before = seen.filter(
    ([x, y]) =>
      Math.abs(Math.atan2(y, x) - bearing) * Math.hypot(x, y) < 0.03 + 0.01 * Math.hypot(x, y) &&
      Math.hypot(x, y) > 0.3,
  );
  const nearest = Math.min(Infinity, ...before.map((one) => Math.hypot(...one)));
  return nearest + BEHIND < distance ? nearest : Infinity;
};
