/**
 * A session's record, and its values at a time. Pure; the columns are those of
 * docs/reference/replay.md, times in seconds since the robot was granted.
 */

import { wrap } from "../../lib/transforms.js";

/**
 * @typedef {object} SessionRecord
 * @property {number} begin Unix seconds
 * @property {number} duration s
 * @property {boolean} ended
 * @property {Record<string, number[]>} states t, x, y, theta, localized, v, w, charge, docked,
 *   clearance, contacts
 * @property {Record<string, number[]>} commands t, v, w, method, way, age
 * @property {string[]} words of the codes of `method` and `way`
 * @property {Record<string, (number | null)[]>} network t, roundTrip, loss, fps, bitrate, frameAge
 * @property {[number, string, string, string][]} events seconds, source, type, details
 */

/**
 * @typedef {{x: number, y: number, theta: number, localized: boolean, index: number,
 *   stale: boolean}} Moment
 */

const GAP = 2; // s without a state, in which the robot's path is unknown
const JUMP = 1.5; // m; more between two states is a new localization
const SPEED = 2.5; // m/s

/**
 * The index of the last time that is not after `t`; -1 before the first.
 * @param {number[]} times ascending @param {number} t
 */
export const lastBefore = (times, t) => {
  let [low, high] = [0, times.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] <= t) {
      low = middle + 1;
    } else {
      high = middle;
    }
  }
  return low - 1;
};

/**
 * Whether the robot drove from one state to the next.
 * @param {Record<string, number[]>} states @param {number} i of the earlier
 */
export const follows = ({ t, x, y, localized }, i) => {
  const seconds = t[i + 1] - t[i];
  const metres = Math.hypot(x[i + 1] - x[i], y[i + 1] - y[i]);
  const isKnown = Boolean(localized[i] && localized[i + 1]);
  return isKnown && seconds <= GAP && metres <= JUMP + SPEED * seconds;
};

/**
 * The robot's pose: of the states, on a straight line between two of them, or the last known one.
 * @param {Record<string, number[]>} states @param {number} t s
 * @returns {Moment | null} null without any state
 */
export const momentAt = (states, t) => {
  if (!states.t.length) {
    return null;
  }
  const i = Math.max(0, lastBefore(states.t, t));
  const here = {
    x: states.x[i],
    y: states.y[i],
    theta: states.theta[i],
    localized: Boolean(states.localized[i]),
    index: i,
    stale: t - states.t[i] > GAP,
  };
  if (t <= states.t[i] || i + 1 >= states.t.length || !follows(states, i)) {
    return here;
  }
  const share = (t - states.t[i]) / (states.t[i + 1] - states.t[i]);
  const x = here.x + share * (states.x[i + 1] - here.x);
  const y = here.y + share * (states.y[i + 1] - here.y);
  const theta = here.theta + share * wrap(states.theta[i + 1] - here.theta);
  return { ...here, x, y, theta, stale: false };
};

/**
 * The command in force: the last one, unless it is too old.
 * @param {SessionRecord} record @param {number} t
 * @returns {{v: number, w: number, method: string, way: string, age: number | null} | null}
 */
export const commandAt = ({ commands, words }, t) => {
  const i = lastBefore(commands.t, t);
  if (i < 0 || t - commands.t[i] > 0.5) {
    return null;
  }
  return {
    v: commands.v[i],
    w: commands.w[i],
    method: words[commands.method[i]] ?? "",
    way: words[commands.way[i]] ?? "",
    age: commands.age[i],
  };
};

/**
 * The network sample of a time.
 * @param {SessionRecord} record @param {number} t @returns {Record<string, number | null> | null}
 */
export const networkAt = ({ network }, t) => {
  const i = lastBefore(/** @type {number[]} */ (network.t), t);
  return i < 0 || t - Number(network.t[i]) > 3
    ? null
    : Object.fromEntries(Object.entries(network).map(([name, column]) => [name, column[i]]));
};

/**
 * Pieces of the path as pairs of indices, first and last, each driven without a break.
 * @param {Record<string, number[]>} states @returns {[number, number][]}
 */
export const piecesOf = (states) => {
  /** @type {[number, number][]} */
  const pieces = [];
  let first = 0;
  for (let i = 0; i < states.t.length; i += 1) {
    if (i + 1 === states.t.length || !follows(states, i)) {
      if (i > first) {
        pieces.push([first, i]);
      }
      first = i + 1;
    }
  }
  return pieces;
};
