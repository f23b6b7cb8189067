/**
 * Asks the robot where it would drive to a point of the map (`command/route`). A question is
 * repeated until it is answered; while the point moves, at most four questions a second are sent.
 */

import { freshId } from "../lib/ids.js";
import { roleOf } from "./session.js";
import { can, maySend } from "./capabilities.js";

const PERIOD = 0.25; // s between two questions
const PATIENCE = 0.7; // s until one is repeated
const SAME = 0.1; // m between two points with one answer

/** @typedef {{points: Point[], reason: string}} Preview `points` from the robot, of the map, m */

/** Whether the robot can be asked, and may then be sent there. @param {State} state */
export const mayPreview = (state) =>
  Boolean(
    roleOf(state.visit) === "driver" &&
    state.factsheet?.previewsRoutes &&
    state.robot?.pose.localized &&
    can(state, "goto") &&
    maySend(state, "map"),
  );

/** @param {Point} one @param {Point} other */
const apart = (one, other) => Math.hypot(one[0] - other[0], one[1] - other[1]);

export class RoutePreview {
  /** @param {(request: {requestId: string, x: number, y: number}) => void} send */
  constructor(send) {
    this.send = send;
    /** @type {Point | null} */
    this.wanted = null;
    /** @type {{id: string, point: Point, at: number, found: Preview | null} | null} */
    this.asked = null;
  }

  /** @param {Point} point m, of the map @param {number} now s */
  ask(point, now) {
    this.wanted = point;
    this.tick(now);
  }

  forget() {
    this.wanted = this.asked = null;
  }

  /** @param {number} now s */
  tick(now) {
    const { wanted, asked } = this;
    const isAsked = wanted !== null && asked !== null && apart(asked.point, wanted) < SAME;
    const pause = asked === null ? 0 : isAsked ? PATIENCE : PERIOD;
    if (wanted === null || (isAsked && asked.found) || (asked && now - asked.at < pause)) {
      return;
    }
    const id = isAsked ? asked.id : freshId("route-");
    this.asked = { id, point: isAsked ? asked.point : wanted, at: now, found: null };
    this.send({ requestId: id, x: this.asked.point[0], y: this.asked.point[1] });
  }

  /** @param {ToPage["route"]} message @returns {boolean} whether it is the answer */
  heard({ requestId, points, reason }) {
    if (this.asked?.id !== requestId) {
      return false;
    }
    this.asked.found = { points, reason };
    return true;
  }

  /**
   * The answer for a point, null before it arrives.
   * @param {Point} point @returns {Preview | null}
   */
  answerFor(point) {
    return this.asked && apart(this.asked.point, point) < SAME ? this.asked.found : null;
  }
}
