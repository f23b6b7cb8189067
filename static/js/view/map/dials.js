/**
 * Beside the map: which room, how fast, how far and for how long. Pure readings and their elements.
 */

import { clockTime } from "../../lib/clock.js";
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
 * @param {any} plan @param {{x: number, y: number} | undefined} pose
 * @returns {string} the room's title, or nothing
 */
export const roomAt = (plan, pose) =>
  (pose &&
    plan?.rooms?.find((/** @type {any} */ room) => contains(room.polygon, pose.x, pose.y))
      ?.title) ||
  "";

/**
 * @param {GetElement} element
 * @param {string} language a BCP 47 tag
 * @returns {(state: State) => void}
 */
export const createDials = (element, language) => {
  const one = new Intl.NumberFormat(language, {
    minimumFractionDigits: 1,
    maximumFractionDigits: 1,
  });
  const two = new Intl.NumberFormat(language, {
    minimumFractionDigits: 2,
    maximumFractionDigits: 2,
  });
  return (state) => {
    const { robot, plan, visit, began, now } = state;
    const drives = visit.phase === "driving" && began !== null;
    write(element("dial-room"), roomAt(plan, robot?.pose) || "–");
    const known = knownNow(state);
    write(element("dial-speed"), known ? two.format(Math.abs(known.velocity.linear)) : "–");
    write(
      element("dial-distance"),
      drives && robot ? one.format(Math.max(0, robot.distance - began.distance)) : "–",
    );
    write(element("dial-time"), drives ? clockTime(Math.max(0, now - began.at)) : "–");
  };
};
