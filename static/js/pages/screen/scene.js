/** Decides what a robot's own display shows. Pure. */

import { SERVER_SILENCE } from "../../protocol/faults.js";
import { isHeld, releaseOf } from "../../protocol/estop_release.js";

export const STALE = 4; // s without a state until a robot with a driver counts as offline
export const STALE_IDLE = 45; // without a driver, it may be silent for 30 s (robots/api/idle.py)
const UNCONFIRMED = 2; // s until the page says that a stop is not confirmed
const SURE = 15; // s that the page waits for the confirmation of a release
const READING = 8; // s that a denied request is shown
const ANSWERED = 5; // s after a request in which a denial is about it
const ALONE = new Set(["goto", "docking"]); // modes of a robot that returns to its dock

/**
 * @typedef {object} Known
 * @property {boolean | null} keyed whether the server accepts this display; null while unknown
 * @property {{title: string, titles?: Record<string, string>, session: string | null,
 *   visitor: string | null, waiting?: string | null, study: boolean} | null} screen
 * @property {any} state the robot's last one
 * @property {number} heardAt when it was received, Unix seconds
 * @property {boolean} online whether the robot is, as far as the server knows
 * @property {{id: string, since: number} | null} stop that was pressed here and is not echoed
 * @property {import("../../protocol/estop_release.js").Release | null} [release] requested here
 * @property {number | null} [askedAt] since when a release waits for its confirmation
 * @property {boolean} [sounds] whether the browser lets this page play sound
 * @property {"" | "refused" | "missing"} [trouble] with this display's camera or microphone
 * @property {boolean} [failing] whether a part of the server does not work
 * @property {boolean} [linked] whether the WebRTC link is live: a stop needs no server
 * @property {number} [actedAt] time of the last request made here, Unix seconds
 * @property {number} [deniedAt] time of the last denial
 */

/**
 * @typedef {object} Display
 * @property {"starting" | "no_key" | "offline" | "idle" | "returning" | "waiting" | "ringing"
 *   | "seen" | "speaking" | "visiting"} scene
 * @property {string} text the scene whose text is shown
 * @property {string} name
 * @property {boolean} study
 * @property {number} sound
 * @property {boolean} whole
 * @property {boolean} canPoint
 * @property {boolean} canWrite
 * @property {boolean} canHangUp
 * @property {string} knock
 * @property {number} watching
 * @property {"" | "ours" | "held" | "other" | "wait" | "unconfirmed" | "unreleased" | "sure"
 *   | "runs_on"} stopped
 * @property {"" | "offered" | "sure" | "asked"} release
 */

/** @param {Known} known @param {number} now @returns {Display} */
export const sceneFor = (known, now) => {
  const { screen, state } = known;
  const call = state?.call ?? null;
  const through = call?.status === "accepted";
  const name = screen?.visitor ?? screen?.waiting ?? "";
  const visited = screen?.visitor != null;
  const scene = sceneOf(known, call, now);
  const shares = Boolean(call?.shares);
  const knocks = visited && scene !== "offline" && state?.knock?.status === "ringing";
  const viewers = (state?.viewers ?? 0) - (state?.session ? 1 : 0);
  return {
    scene,
    text: scene === "speaking" && !known.sounds ? "silent" : scene,
    name,
    study: visited && Boolean(screen?.study),
    sound: visited && through && call.audio ? call.volume : 0,
    whole: shares,
    canPoint: scene === "seen" && shares,
    canWrite: visited || (scene === "waiting" && screen?.waiting != null),
    canHangUp: visited && through && (call.audio || call.video),
    knock: knocks ? state.knock.actionId : "",
    watching: scene === "offline" || scene === "no_key" ? 0 : Math.max(0, viewers),
    ...stopOf(known, now),
  };
};

/**
 * The key of the line about a problem, or "".
 * @param {Known} known @param {number} silence s since the server's last packet @param {number} now
 */
export const troubleOf = (known, silence, now) => {
  const { trouble = "", failing, linked, actedAt = -Infinity, deniedAt = -Infinity } = known;
  if (silence > SERVER_SILENCE) {
    return "server.silent";
  }
  if (now - deniedAt < READING && deniedAt >= actedAt && deniedAt - actedAt < ANSWERED) {
    return "denied";
  }
  if (failing) {
    return linked ? "server.failing" : "server.failing_unlinked";
  }
  return trouble && `give.${trouble}`;
};

/**
 * The robot's title in the page's language, empty while unknown.
 * @param {Known["screen"]} screen @param {string} language a BCP 47 tag
 */
export const titleOf = (screen, language) => {
  const { title = "", titles = {} } = screen ?? {};
  const wanted = language.toLowerCase();
  return titles[wanted] ?? titles[wanted.split("-")[0]] ?? title;
};

/** @param {Known} known @param {any} call @param {number} now */
const sceneOf = ({ keyed, screen, state, heardAt, online }, call, now) => {
  if (keyed === false) {
    return "no_key";
  }
  if (!screen) {
    return "starting";
  }
  if (!online || (state && now - heardAt > (screen.session === null ? STALE_IDLE : STALE))) {
    return "offline";
  }
  if (screen.visitor === null) {
    const isWaitedFor = screen.waiting !== null && screen.waiting !== undefined;
    return isWaitedFor ? "waiting" : ALONE.has(state?.mode) ? "returning" : "idle";
  }
  if (call?.status === "ringing" || call?.status === "unanswered") {
    return "ringing";
  }
  if (call?.status !== "accepted") {
    return "visiting";
  }
  return call.video ? "seen" : call.audio ? "speaking" : "visiting";
};

/**
 * The line about a stop, and the button that releases one pressed here, or between sessions.
 * @param {Known} known @param {number} now @returns {Pick<Display, "stopped" | "release">}
 */
const stopOf = (known, now) => {
  const stopped = stoppedBy(known, now);
  if (stopped !== "ours" && stopped !== "held") {
    return { stopped, release: "" };
  }
  const release = releaseOf(known.release ?? null, now);
  if (release !== "asked" && known.askedAt && now - known.askedAt < SURE) {
    return { stopped: "sure", release: "sure" };
  }
  return release === "failed"
    ? { stopped: "unreleased", release: "offered" }
    : { stopped, release };
};

/** @param {Known} known @param {number} now @returns {Display["stopped"]} */
const stoppedBy = ({ state, stop, screen }, now) => {
  if (stop) {
    return now - stop.since > UNCONFIRMED ? "unconfirmed" : "wait";
  }
  if (state?.errors?.some((/** @type {string} */ error) => error.startsWith("runs_on: "))) {
    return "runs_on";
  }
  if (!state?.safety?.estop) {
    return screen && isHeld(state, screen.visitor) ? "held" : "";
  }
  return (state.safety.estopSource ?? "").split(":")[0] === "screen" ? "ours" : "other";
};
