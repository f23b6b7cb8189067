/** Beside the map: room, speed, distance and time of the drive. */

import { clockTime } from "../../lib/clock.js";
import { decimalFormat } from "../../lib/decimal.js";
import { write } from "../../lib/dom.js";
import { knownNow } from "../../protocol/standstill.js";

/**
 * Whether a point lies in a simple polygon (even-odd rule).
 * @param {Point[]} polygon @param {number} x @param {number} y
 */
export const contains = (polygon, x, y) => {
  let inside = false;
  polygon.forEach(([ax, ay], i) => {
    const [bx, by] = polygon[(i + 1) % polygon.length];
    if (ay > y !== by > y && x < ax + ((y - ay) / (by - ay)) * (bx - ax)) {
      inside = !inside;
    }
  });
  return inside;
};

/**
 * @param {any} plan @param {{x: number, y: number} | undefined} pose @returns {string} a title, or
 * ""
 */
export const roomAt = (plan, pose) => {
  const isIn = (/** @type {any} */ { polygon }) => pose && contains(polygon, pose.x, pose.y);
  return plan?.rooms?.find(isIn)?.title ?? "";
};

/** @param {GetElement} element @param {string} language @returns {(state: State) => void} */
export const createDials = (element, language) => {
  const [one, two] = [decimalFormat(language, 1), decimalFormat(language, 2)];
  return (state) => {
    const { robot, plan, visit, began, trip, now } = state;
    const drives = visit.phase === "driving" && began !== null;
    write(element("dial-room"), roomAt(plan, robot?.pose) || "–");
    const known = knownNow(state);
    const unknown = visit.phase === "driving" ? "–" : "";
    write(element("dial-speed"), known ? two(Math.abs(known.velocity.linear)) : unknown);
    // of this drive, or of the one that has just ended
    const metres = drives && robot ? Math.max(0, robot.distance - began.distance) : trip?.metres;
    const seconds = drives ? Math.max(0, now - began.at) : trip && 60 * trip.minutes;
    write(element("dial-distance"), metres === undefined ? "" : one(metres));
    write(element("dial-time"), seconds === null ? "" : clockTime(seconds));
  };
};
