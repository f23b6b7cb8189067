/**
 * After one press, the page drives the robot to a point, turns it, or drives it out of its dock: by
 * velocities as from any other controller, through the same arbiter, and under the name of the
 * controller that was pressed. It ends by itself, and at any other input of the visitor.
 */

import { wrap } from "../lib/transforms.js";
import { sweep } from "../lib/swept_path.js";
import { backOut, towards, turnTo, arcTo } from "./pure_pursuit.js";

const STALE = 0.7; // s without a pose of the robot
const JUMP = 0.6; // m between two poses: it was localized somewhere else
const PATIENCE = 3; // s without progress
const PROGRESS = 0.03; // m and rad
const LOOK_AHEAD = 0.35; // m beyond the braking distance: an obstacle there ends it

/**
 * @typedef {"goal" | "turn" | "back"} Kind
 * @typedef {"there" | "blocked" | "stuck" | "lost" | "taken"} End
 * @typedef {{moment: Moment | null, age: number,
 *   full: import("./pure_pursuit.js").Full, limits: any, footprint: Point[],
 *   seen: Point[]}} World
 */

const VELOCITIES = { goal: towards, turn: turnTo, back: backOut };

export class Maneuver {
  /**
   * @param {object} options
   * @param {(method: string, velocity: {linear: number, angular: number}) => boolean} options.offer
   *   false when something newer steers
   * @param {(end: End, kind: string) => void} options.onEnd not called when the visitor ends it
   */
  constructor({ offer, onEnd }) {
    this.offer = offer;
    this.onEnd = onEnd;
    this.methods = ["mouse", "touch", "keyboard"];
    this.yields = true;
    /**
     * @type {{kind: Kind, point: Point, method: string, at: Point,
     *   turned: number, movedAt: number} | null}
     */
    this.now = null;
  }

  enable() {}

  disable() {
    this.letGo();
  }

  /**
   * Starts a maneuver in place of another.
   * @param {Kind} kind
   * @param {Point} point of the map: the goal, the point to look at, or the robot's position
   * @param {string} method @param {number} now s
   */
  start(kind, point, method, now) {
    if (this.now && this.now.method !== method) {
      this.letGo();
    }
    const before = this.now?.kind === kind ? this.now : null;
    this.now = {
      at: before?.at ?? [NaN, NaN],
      turned: before?.turned ?? NaN,
      movedAt: before?.movedAt ?? now,
      kind,
      point,
      method,
    };
  }

  /** Ends the maneuver without `onEnd`. */
  letGo() {
    if (this.now) {
      const { method } = this.now;
      this.now = null;
      this.offer(method, { linear: 0, angular: 0 });
    }
  }

  /** @param {World} world @param {number} now s */
  tick(world, now) {
    if (!this.now) {
      return;
    }
    const { moment } = world;
    if (!moment || world.age > STALE || this.#jumped(moment)) {
      this.#end("lost");
      return;
    }
    this.#watch(moment, now);
    const { kind, point, method, movedAt } = this.now;
    const velocity = VELOCITIES[kind](moment, point, world.full, world.limits.linearBraking / 2);
    if (!velocity) {
      this.#end("there");
    } else if (kind === "goal" && isBlocked(moment, point, world)) {
      this.#end("blocked");
    } else if (now - movedAt > PATIENCE) {
      this.#end("stuck");
    } else if (!this.offer(method, velocity)) {
      this.#end("taken");
    }
  }

  /** @param {End} end */
  #end(end) {
    const kind = this.now?.kind ?? "goal";
    this.letGo();
    this.onEnd(end, kind);
  }

  /** @param {Moment} moment */
  #jumped({ x, y }) {
    const at = this.now?.at;
    return at !== undefined && Math.hypot(x - at[0], y - at[1]) > JUMP;
  }

  /** Notes progress. @param {Moment} moment @param {number} now */
  #watch({ x, y, theta }, now) {
    if (
      this.now &&
      !(
        Math.hypot(x - this.now.at[0], y - this.now.at[1]) < PROGRESS &&
        Math.abs(wrap(theta - this.now.turned)) < PROGRESS
      )
    ) {
      Object.assign(this.now, { at: [x, y], turned: theta, movedAt: now });
    }
  }
}

/** @param {Moment} moment @param {Point} goal @param {World} world */
const isBlocked = (moment, goal, { limits, footprint, seen }) => {
  const brakes = (moment.linear * moment.linear) / (2 * limits.linearBraking) + LOOK_AHEAD;
  const sweptPath = sweep(arcTo(moment, goal), footprint, seen);
  return sweptPath !== null && sweptPath.blocked && sweptPath.length < brakes;
};
