/**
 * The arrow at the upper edge of the video, or at its side, that points to the target of the cue.
 */

import { roleOf } from "../protocol/session.js";
import { decimalFormat } from "../lib/decimal.js";
import { write } from "../lib/dom.js";
import { robotFromMap } from "../lib/transforms.js";
import { targetOf } from "./guide.js";

const USUAL_VIEW = 1.0; // rad, for a robot without a field of view in its factsheet
const BEHIND = 2.4; // rad
const EDGE = 0.92; // of half the video: beyond, the arrow points aside

/**
 * @typedef {{side: "ahead" | "left" | "right" | "behind", share: number, distance: number}}
 *   Pointing
 */

/**
 * @param {{x: number, y: number, theta: number}} pose of the robot
 * @param {{x: number, y: number}} target m
 * @param {number} hfov of its camera, rad
 * @returns {Pointing} `share`: from the left edge of the video, -1, to the right one, 1
 */
export const pointTo = (pose, target, hfov) => {
  const [x, y] = robotFromMap(pose, [target.x, target.y]);
  const bearing = Math.atan2(y, x);
  const share =
    Math.abs(bearing) < Math.PI / 2
      ? -Math.tan(bearing) / Math.tan(hfov / 2)
      : -Math.sign(bearing) * Infinity;
  const aside = bearing > 0 ? "left" : "right";
  const away = Math.abs(bearing) >= BEHIND ? "behind" : aside;
  const side = Math.abs(share) <= EDGE ? "ahead" : away;
  return { side, share: Math.max(-1, Math.min(1, share)), distance: Math.hypot(x, y) };
};

/**
 * @param {GetElement} element @param {Words} words
 * @param {() => {x: number, y: number, theta: number, localized: boolean} | null} poseNow the
 *   newest pose there is
 * @param {string} language a BCP 47 tag
 */
export const createDirectionArrow = (element, words, poseNow, language) => {
  const arrow = element("pointer");
  const metres = decimalFormat(language, 1);
  return (/** @type {State} */ state) => {
    const target = roleOf(state.visit) === "driver" && state.playing ? targetOf(state) : null;
    const pose = poseNow();
    arrow.hidden = !target || !pose?.localized;
    if (!target || !pose?.localized) {
      return;
    }
    const hfov = state.factsheet?.camera?.hfov ?? USUAL_VIEW;
    const { side, share, distance } = pointTo(pose, target, hfov);
    arrow.dataset.side = side;
    arrow.dataset.half = share < 0 ? "left" : "right";
    arrow.style.setProperty("--share", share.toFixed(3));
    write(element("pointer-text"), words.say("reading.metres", { metres: metres(distance) }));
  };
};
