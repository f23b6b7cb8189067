/**
 * The page drives the robot to a point, turns it, or drives it out of its dock, for a visitor who
 * pressed once: the same velocities as from any other controller, by the same arbiter, and under
 * the same name as the hand that pressed. It ends by itself, and at everything else that the
 * visitor does.
 */

import { wrap } from "../lib/transforms.js";
import { sweep } from "../lib/swept_path.js";
import { backOut, towards, turnTo, arcTo } from "./pure_pursuit.js";

const STALE = 0.7; // s without news of where the robot is
const JUMP = 0.6; // m between two looks: it found itself somewhere else
const PATIENCE = 3; // s without getting on
const PROGRESS = 0.03; // m
const LOOK_AHEAD = 0.35; // m beyond the way of braking: what stands there ends it

/** @typedef {"goal" | "turn" | "back"} Kind */
/** @typedef {"there" | "blocked" | "stuck" | "lost" | "taken"} End */
/**
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
   * @param {(end: End, kind: string) => void} options.onEnd not told when the visitor let go
   */
  constructor({ offer, onEnd }) {
    this.offer = offer;
    this.onEnd = onEnd;
    this.methods = ["mouse", "touch", "keyboard"];
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
   * Drive there from now on; another maneuver is over.
   * @param {Kind} kind
   * @param {Point} point of the map: the goal, what to look at, or where the robot stands
   * @param {string} method
   * @param {number} now s
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

  /** The visitor does not want it any more. */
  letGo() {
    if (this.now) {
      const { method } = this.now;
      this.now = null;
      this.offer(method, { linear: 0, angular: 0 });
    }
  }

  outdone() {
    this.letGo();
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
    const velocity = VELOCITIES[this.now.kind](
      moment,
      this.now.point,
      world.full,
      world.limits.linearBraking / 2,
    );
    if (!velocity) {
      this.#end("there");
    } else if (this.now.kind === "goal" && isBlocked(moment, this.now.point, world)) {
      this.#end("blocked");
    } else if (now - this.now.movedAt > PATIENCE) {
      this.#end("stuck");
    } else if (!this.offer(this.now.method, velocity)) {
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

  /** Whether it gets on. @param {Moment} moment @param {number} now */
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
