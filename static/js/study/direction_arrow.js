/**
 * The arrow at the upper edge of the picture, or at its side, that points to where the cue leads.
 * It stays clear of the floor ahead.
 */

import { roleOf } from "../protocol/session.js";
import { write } from "../lib/dom.js";
import { wrap } from "../lib/transforms.js";
import { targetOf } from "./guide.js";

const USUAL_VIEW = 1.0; // rad, for a robot that does not say what its camera sees
const BEHIND = 2.4; // rad
const EDGE = 0.92; // of half a picture: nearer to its edge the arrow points aside

/**
 * @typedef {{side: "ahead" | "left" | "right" | "behind", share: number, distance: number}}
 *   Pointing
 */

/**
 * @param {{x: number, y: number, theta: number}} pose of the robot
 * @param {{x: number, y: number}} target m
 * @param {number} hfov of its camera, rad
 * @returns {Pointing} `share` is where in the picture that lies: -1 its left edge, 1 its right one
 */
export const pointTo = (pose, target, hfov) => {
  const [dx, dy] = [target.x - pose.x, target.y - pose.y];
  const bearing = wrap(Math.atan2(dy, dx) - pose.theta);
  const share =
    Math.abs(bearing) < Math.PI / 2
      ? -Math.tan(bearing) / Math.tan(hfov / 2)
      : -Math.sign(bearing) * Infinity;
  const side =
    Math.abs(share) <= EDGE
      ? "ahead"
      : Math.abs(bearing) >= BEHIND
        ? "behind"
        : bearing > 0
          ? "left"
          : "right";
  return { side, share: Math.max(-1, Math.min(1, share)), distance: Math.hypot(dx, dy) };
};

/**
 * @param {GetElement} element @param {Words} words
 * @param {() => {x: number, y: number, theta: number, localized: boolean} | null} poseNow the
 *   newest pose there is
 * @param {string} language a BCP 47 tag
 */
export const createDirectionArrow = (element, words, poseNow, language) => {
  const arrow = element("pointer");
  const metres = new Intl.NumberFormat(language, {
    minimumFractionDigits: 1,
    maximumFractionDigits: 1,
  });
  return (/** @type {State} */ state) => {
    const target = roleOf(state.visit) === "driver" && state.playing ? targetOf(state) : null;
    const pose = poseNow();
    arrow.hidden = !target || !pose?.localized;
    if (!target || !pose?.localized) {
      return;
    }
    const { side, share, distance } = pointTo(
      pose,
      target,
      state.factsheet?.camera?.hfov ?? USUAL_VIEW,
    );
    arrow.dataset.side = side;
    arrow.dataset.half = share < 0 ? "left" : "right";
    arrow.style.setProperty("--share", share.toFixed(3));
    write(
      element("pointer-text"),
      words.say("reading.metres", { metres: metres.format(distance) }),
    );
  };
};
