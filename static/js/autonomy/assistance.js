/**
 * Why the robot does not do quite what its driver asks: which word, and on which side. Pure.
 */

export const HOLD_SECONDS = 0.5;
const WHYS = new Set(["slow", "stop", "steer", "blind"]);
// rad; a point within this angle of straight ahead is ahead, the same behind
const AHEAD = Math.PI / 4;

/**
 * @typedef {{why: string, side: string, point: [number, number] | null}} Help nothing is `why: ""`
 */

/** @type {Help} */
export const NO_HELP = Object.freeze({ why: "", side: "", point: null });

/**
 * @param {[number, number] | null} point metres, robot's frame, x forward, y left
 * @returns {"ahead" | "left" | "right" | "behind" | ""}
 */
export const sideOf = (point) => {
  if (point === null) {
    return "";
  }
  const angle = Math.atan2(point[1], point[0]);
  if (Math.abs(angle) <= AHEAD) {
    return "ahead";
  }
  if (Math.abs(angle) >= Math.PI - AHEAD) {
    return "behind";
  }
  return angle > 0 ? "left" : "right";
};

/** @param {string} why the robot's word @param {[number, number] | null} point @returns {Help} */
export const helpFrom = (why, point) =>
  WHYS.has(why) ? { why, side: why === "blind" ? "" : sideOf(point), point } : NO_HELP;

/**
 * Keeps a word in sight: near walls the robot's word changes several times a second, and nobody can
 * read that. A first word shows at once; another one, or none, only when the one that is shown has
 * not been heard for half a second.
 */
export class HeldHelp {
  constructor() {
    /** @type {Help} */
    this.shown = NO_HELP;
    this.heardAt = -Infinity;
  }

  /**
   * @param {Help} help what the robot says now
   * @param {number} now Unix seconds
   * @returns {Help} what to show
   */
  hear(help, now) {
    const same = help.why === this.shown.why && help.side === this.shown.side;
    if (same || this.shown.why === "" || now - this.heardAt >= HOLD_SECONDS) {
      this.shown = help;
      this.heardAt = now;
    }
    return this.shown;
  }

  /** Time goes by and the robot says nothing. @param {number} now @returns {Help} */
  tick(now) {
    if (now - this.heardAt >= 2 * HOLD_SECONDS) {
      this.shown = NO_HELP;
    }
    return this.shown;
  }
}

/** The sentence. @param {Help} help @returns {string} a word, or nothing */
export const wordOf = ({ why, side }) => {
  if (why === "") {
    return "";
  }
  return why === "blind" || side === "" ? `assist.${why}` : `assist.${why}.${side}`;
};

/** Which levels can be chosen, none when the robot does not assist. @param {any} factsheet */
export const offersAssist = (factsheet) => Boolean(factsheet?.capabilities?.includes("assist"));

/**
 * The level of assistance that is in force for this page: what the robot reports, not what was
 * pressed, for a study may have fixed it. A robot whose driver is out of reach falls back to its
 * owner's level, which is nobody's choice here: its driver sees the last one of the visit.
 * @param {import("../drive/features.js").State} state
 * @returns {string} empty while unknown
 */
export const assistIn = ({ visit, robot, assistKnown }) => {
  if (visit.phase !== "driving") {
    return visit.online ? (robot?.assist ?? "") : "";
  }
  if (robot && (robot.session ?? null) === visit.session) {
    return robot.assist;
  }
  return assistKnown?.session === visit.session ? assistKnown.level : "";
};
