/**
 * Points of the map in the robot's frame, and back; and the robot's pose at a past moment: when the
 * frame on the screen was taken, or a sweep of its laser. Pure.
 */

const KEPT = 90; // poses: three seconds of the quickest
const CLOCK_STEP = 5; // s; much older means that the robot's clock was set
const AHEAD = 0.25; // s that a pose may be carried on by its velocity
const GAP = 0.6; // s between two poses, beyond which the path between them is unknown

/**
 * `aimed` is false while the tilt is unknown.
 * @typedef {Place & {tilt: number, aimed: boolean, linear: number, angular: number, stamp: number,
 *   localized: boolean}} Moment
 */

/**
 * From the frame of a place to the map, m.
 * @param {Place} place @param {Point} point @returns {Point}
 */
export const mapFromRobot = ({ x, y, theta }, [u, v]) => [
  x + u * Math.cos(theta) - v * Math.sin(theta),
  y + u * Math.sin(theta) + v * Math.cos(theta),
];

/**
 * From the map to the frame of a place, m.
 * @param {Place} place @param {Point} point @returns {Point}
 */
export const robotFromMap = ({ x, y, theta }, [px, py]) => {
  const [dx, dy] = [px - x, py - y];
  return [dx * Math.cos(theta) + dy * Math.sin(theta), dy * Math.cos(theta) - dx * Math.sin(theta)];
};

/** An angle from -π to π. @param {number} angle rad */
export const wrap = (angle) => Math.atan2(Math.sin(angle), Math.cos(angle));

/**
 * Where an arc leads.
 * @param {Place} from
 * @param {number} linear m/s
 * @param {number} angular rad/s
 * @param {number} seconds @returns {Place}
 */
export const along = ({ x, y, theta }, linear, angular, seconds) => {
  const turn = angular * seconds;
  // Chord and half the turn: right for a straight line too.
  const chord = linear * seconds * (Math.abs(turn) < 1e-6 ? 1 : Math.sin(turn / 2) / (turn / 2));
  return {
    x: x + chord * Math.cos(theta + turn / 2),
    y: y + chord * Math.sin(theta + turn / 2),
    theta: theta + turn,
  };
};

export class Track {
  constructor() {
    /** @type {Moment[]} by their stamps */
    this.moments = [];
  }

  /**
   * @param {{stamp: number, pose: Place & {localized: boolean}, velocity: {linear: number,
   *   angular: number}, tilt: number | null}} message `pose` or `state`
   */
  add({ stamp, pose, velocity, tilt }) {
    const last = this.newest;
    if (last && stamp <= last.stamp) {
      if (last.stamp - stamp < CLOCK_STEP) {
        return; // the other transport was faster
      }
      this.moments = [];
    }
    const { x, y, theta, localized } = pose;
    this.moments.push({
      x,
      y,
      theta,
      localized,
      stamp,
      tilt: tilt ?? 0,
      aimed: tilt !== null,
      linear: velocity.linear,
      angular: velocity.angular,
    });
    if (this.moments.length > KEPT) {
      this.moments.shift();
    }
  }

  /** @returns {Moment | null} */
  get newest() {
    return this.moments.at(-1) ?? null;
  }

  /** @param {number | null} stamp robot's clock; null takes the newest @returns {Moment | null} */
  at(stamp) {
    const newest = this.newest;
    if (!newest || stamp === null) {
      return newest;
    }
    if (stamp >= newest.stamp) {
      return {
        ...newest,
        ...along(newest, newest.linear, newest.angular, Math.min(AHEAD, stamp - newest.stamp)),
      };
    }
    const next = this.moments.findIndex((one) => one.stamp >= stamp);
    const [before, after] = [this.moments[next - 1], this.moments[next]];
    if (!before || after.stamp - before.stamp > GAP) {
      return after;
    }
    const share = (stamp - before.stamp) / (after.stamp - before.stamp);
    const mix = (/** @type {number} */ from, /** @type {number} */ to) =>
      from + share * (to - from);
    const theta = before.theta + share * wrap(after.theta - before.theta);
    return {
      ...after,
      x: mix(before.x, after.x),
      y: mix(before.y, after.y),
      theta,
      tilt: mix(before.tilt, after.tilt),
    };
  }
}
