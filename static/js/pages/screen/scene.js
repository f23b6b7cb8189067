/** What a robot's own display shows, from what it was told: decisions only. */

import { SERVER_SILENCE } from "../../protocol/faults.js";
import { isHeld, releaseOf } from "../../protocol/estop_release.js";

/** s without a state after which a robot that somebody drives counts as out of reach */
export const STALE = 4;
/** s for one that nobody drives, which may be silent for half a minute (robots/api/idle.py) */
export const STALE_IDLE = 45;
/** s after which a stop that the robot has not echoed is worth a word */
const UNCONFIRMED = 2;
/** s in which the question whether to release a stop waits for its answer */
const SURE = 15;
const READING = 8; // s that a denied request is shown
const ANSWERED = 5; // s after a request in which a denial is about it
/** what a robot without a visitor does by itself: the server has sent it to its station */
const ALONE = new Set(["goto", "docking"]);

/**
 * @typedef {object} Told
 * @property {boolean} keyed whether the server let this display in; null while unknown
 * @property {{title: string, titles?: Record<string, string>, session: string | null,
 *   visitor: string | null, waiting?: string | null, study: boolean} | null} screen
 * @property {any} state the robot's last one
 * @property {number} heardAt when it came, Unix seconds
 * @property {boolean} online what the server says of the robot
 * @property {{id: string, since: number} | null} stop the stop that was pressed here and is not
 *   echoed
 * @property {import("../../protocol/estop_release.js").Release | null} [release] of a stop
 *   that was asked for here and has not come
 * @property {number | null} [askedAt] when somebody wanted to release it, and was asked whether it
 *   is safe
 * @property {"" | "refused" | "missing"} [trouble] with this display's own camera and microphone
 * @property {boolean} [failing] whether a part of the server does not work
 * @property {boolean} [linked] whether the WebRTC link to the robot lives: a stop needs no server
 * @property {number} [actedAt] time of the last request made here, Unix seconds
 * @property {number} [deniedAt] when the server denied something last
 */

/**
 * @typedef {object} Display
 * @property {"starting" | "no_key" | "offline" | "idle" | "returning" | "waiting" | "ringing"
 *   | "seen" | "speaking" | "visiting"} scene
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

/** @param {Told} told @param {number} now @returns {Display} */
export const sceneFor = (told, now) => {
  const { screen, state } = told;
  const call = state?.call ?? null;
  const through = call?.status === "accepted";
  const name = screen?.visitor ?? screen?.waiting ?? "";
  const visited = screen?.visitor != null;
  const scene = sceneOf(told, call, now);
  const shares = Boolean(call?.shares);
  return {
    scene,
    name,
    study: visited && Boolean(screen?.study),
    sound: visited && through && call.audio ? call.volume : 0,
    whole: shares,
    canPoint: scene === "seen" && shares,
    canWrite: visited || (scene === "waiting" && screen?.waiting != null),
    canHangUp: visited && through && (call.audio || call.video),
    knock:
      visited && scene !== "offline" && state?.knock?.status === "ringing"
        ? state.knock.actionId
        : "",
    watching:
      scene === "offline" || scene === "no_key"
        ? 0
        : Math.max(0, (state?.viewers ?? 0) - (state?.session ? 1 : 0)),
    ...stopOf(told, now),
  };
};

/**
 * The line about what does not work: its word, empty for nothing.
 * @param {Told} told
 * @param {number} silence s since the server's last packet
 * @param {number} now
 */
export const troubleOf = (told, silence, now) => {
  const { trouble = "", failing, linked, actedAt = -Infinity, deniedAt = -Infinity } = told;
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
 * What the robot is called in the page's language, nothing before the server has said it.
 * @param {Told["screen"]} screen
 * @param {string} language a BCP 47 tag
 */
export const titleOf = (screen, language) => {
  const { title = "", titles = {} } = screen ?? {};
  const wanted = language.toLowerCase();
  return titles[wanted] ?? titles[wanted.split("-")[0]] ?? title;
};

/** @param {Told} told @param {any} call @param {number} now */
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
 * The line about a stop, and what the button is for that releases one that was pressed here, or
 * between visits.
 * @param {Told} told @param {number} now @returns {Pick<Display, "stopped" | "release">}
 */
const stopOf = (told, now) => {
  const stopped = stoppedBy(told, now);
  if (stopped !== "ours" && stopped !== "held") {
    return { stopped, release: "" };
  }
  const release = releaseOf(told.release ?? null, now);
  if (release !== "asked" && told.askedAt && now - told.askedAt < SURE) {
    return { stopped: "sure", release: "sure" };
  }
  return release === "failed"
    ? { stopped: "unreleased", release: "offered" }
    : { stopped, release };
};

/** @param {Told} told @param {number} now @returns {Display["stopped"]} */
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
