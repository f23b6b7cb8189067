/** How assistance changes the driver's command: the reason and the side. Pure. */

export const HOLD_SECONDS = 0.5;
const WHYS = new Set(["slow", "stop", "steer", "blind"]);
const AHEAD = Math.PI / 4; // rad from straight ahead; the same behind

/** @typedef {{why: string, side: string, point: Point | null}} Help `why` "": none */

/** @type {Help} */
export const NO_HELP = Object.freeze({ why: "", side: "", point: null });

/**
 * @param {Point | null} point metres, robot's frame, x forward, y left
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

/** @param {string} why the robot's word @param {Point | null} point @returns {Help} */
export const helpFrom = (why, point) =>
  WHYS.has(why) ? { why, side: why === "blind" ? "" : sideOf(point), point } : NO_HELP;

/**
 * Keeps a reason readable, which near walls changes several times a second. The first one is shown
 * at once; another, or none, half a second after the shown one was last reported.
 */
export class HeldHelp {
  constructor() {
    /** @type {Help} */
    this.shown = NO_HELP;
    this.heardAt = -Infinity;
  }

  /** @param {Help} help reported now @param {number} now Unix seconds @returns {Help} to show */
  hear(help, now) {
    const same = help.why === this.shown.why && help.side === this.shown.side;
    if (same || this.shown.why === "" || now - this.heardAt >= HOLD_SECONDS) {
      this.shown = help;
      this.heardAt = now;
    }
    return this.shown;
  }

  /** Without a report. @param {number} now @returns {Help} */
  tick(now) {
    if (now - this.heardAt >= 2 * HOLD_SECONDS) {
      this.shown = NO_HELP;
    }
    return this.shown;
  }
}

/** The key of its sentence, or "". @param {Help} help @returns {string} */
export const wordOf = ({ why, side }) =>
  why && (why === "blind" || side === "" ? `assist.${why}` : `assist.${why}.${side}`);

/**
 * The level of assistance in force, as the robot reports it while somebody drives. Without its
 * driver it reports its owner's level: the page then shows that of the visitor's last session, and
 * before it that of the next.
 * @param {State} state
 * @returns {string} empty while unknown
 */
export const assistIn = ({ visit, robot, assistKnown, assistUsual }) => {
  if (visit.phase !== "driving") {
    return robot?.session && visit.online ? robot.assist : assistUsual;
  }
  if (robot && (robot.session ?? null) === visit.session) {
    return robot.assist;
  }
  return assistKnown?.session === visit.session ? assistKnown.level : "";
};
