/**
 * Decides the one line over the video: the most important alert now. Pure; shown by readings.js.
 */

import { clockTime } from "../../lib/clock.js";
import { isHeld } from "../../protocol/estop_release.js";
import { isUnsettled } from "../../protocol/denials.js";
import { roleOf } from "../../protocol/session.js";
import { isAnswered, wayOut } from "../../autonomy/offer.js";
import { wordOf } from "../../autonomy/assistance.js";
import { reports, isAway, isCutOff } from "../../protocol/standstill.js";
import { profileOf } from "../display/profiles.js";
import { faultAlert } from "../../protocol/faults.js";

const SLOW_SECONDS = 0.4;
const READING_SECONDS = 8; // of a sentence that nothing else removes
const NEEDED = new Set(["stop", "blind"]); // assistance that explains why the robot does not move
/**
 * Alerts of the robot that are shown while a card is open; faults of the server are on the card.
 */
const OVER_CARDS = /^alert\.(estop|estop_screen|runs_on|stop_unconfirmed)$/;
/** In which a visitor without video waits for the server's answer, or in the queue. */
const ASKING = new Set(["taking", "queued", "turn"]);

/**
 * @typedef {{word: string, tone: "danger" | "busy" | "calm",
 *   values?: Record<string, string | number>} | null} Alert
 */

const RUNS_ON = /** @type {const} */ ({ word: "alert.runs_on", tone: "danger" });

/** @param {string} word */
export const staysOverCards = (word) => OVER_CARDS.test(word);

/** @param {State} state @returns {Alert} */
export const alertFor = (state) => {
  const { visit, robot } = state;
  // the emergency stop includes any other stop
  if (state.stopUnconfirmed && !robot?.safety.estop) {
    return { word: "alert.stop_unconfirmed", tone: "danger" };
  }
  if (!roleOf(visit)) {
    const isMoving = ASKING.has(visit.phase) && !isCutOff(state) && reports(robot, "runs_on");
    return isMoving ? RUNS_ON : (serverAlert(state) ?? denialAlert(state));
  }
  const denial = denialAlert(state);
  return (
    robotAlert(state) ??
    faultAlert(state) ??
    linkAlert(state) ??
    (robot
      ? (answerAlert(state) ??
        // a slow connection is shown for as long as it is slow, a denial for some seconds
        (denial ? null : slowAlert(state)) ??
        helpAlert(state) ??
        denial ??
        lostAlert(state) ??
        diskAlert(state) ??
        quietAlert(state))
      : denial)
  );
};

/**
 * A line on the card, which covers the one over the video: faults of the server, or its denials.
 * @param {State} state @returns {Alert}
 */
export const warningFor = (state) => serverAlert(state) ?? denialAlert(state) ?? diskAlert(state);

/**
 * The server does not work, or cannot be reached.
 * @param {State} state @returns {Alert}
 */
const serverAlert = (state) => {
  const { visit, serverSilent } = state;
  const cutOff = visit.socket === "lost" || serverSilent;
  if (!roleOf(visit)) {
    const asks = visit.phase !== "lobby" && visit.phase !== "closed";
    if (cutOff) {
      return asks ? { word: "alert.server", tone: "busy" } : null;
    }
    return ASKING.has(visit.phase) ? faultAlert(state) : null;
  }
  const fault = faultAlert(state);
  if (fault) {
    return fault;
  }
  if (visit.link === "live") {
    return cutOff || !visit.online ? { word: "alert.server_only", tone: "busy" } : null;
  }
  if (cutOff && visit.phase === "driving") {
    return { word: "alert.server_driver", tone: "danger" };
  }
  return cutOff || visit.serverBlind ? { word: "alert.server", tone: "busy" } : null;
};

/** @param {State} state @returns {Alert} */
const diskAlert = ({ visit, faults }) => {
  const fault = roleOf(visit) && faults.find((/** @type {any} */ { then }) => then === "goes_on");
  return fault ? { word: `fault.${fault.part}`, tone: "busy" } : null;
};

/** @param {State} state @returns {Alert} */
const robotAlert = (state) => {
  const { visit, robot, room, operates } = state;
  // A robot with a live link is online, whatever the server knows.
  if (!visit.online && visit.link !== "live") {
    const offline = isUnguarded(state) ? "alert.offline_unguarded" : "alert.robot_offline";
    const blind = /** @type {const} */ ({ word: "alert.server", tone: "busy" });
    return faultAlert(state) ?? (visit.serverBlind ? blind : { word: offline, tone: "danger" });
  }
  if (isCutOff(state)) {
    return null; // its last state may be outdated
  }
  if (reports(robot, "runs_on")) {
    return RUNS_ON;
  }
  if (robot?.safety.estop) {
    const isScreen = robot.safety.estopSource?.startsWith("screen");
    return { word: isScreen ? "alert.estop_screen" : "alert.estop", tone: "danger" };
  }
  if (robot?.safety.inhibited === "fault") {
    return { word: isAway(robot) ? "alert.not_connected" : "alert.fault", tone: "danger" };
  }
  if (reports(robot, "cancel")) {
    return { word: "alert.cancel", tone: "busy" };
  }
  const touched = touchedWord(robot?.safety.touched ?? []);
  if (touched || robot?.safety.collision) {
    return { word: touched || "alert.collision", tone: "busy" };
  }
  if (visit.phase === "watching" && !operates && isHeld(robot, room.driver)) {
    return { word: "alert.held", tone: "busy" };
  }
  return isUnguarded(state) && ["goto", "docking"].includes(robot?.mode)
    ? { word: "alert.unguarded", tone: "busy" }
    : null;
};

/**
 * Whether the robot's own navigation continues when the robot's computer is cut off.
 * @param {State} state
 */
const isUnguarded = ({ factsheet }) => factsheet?.navigationControl === "unguarded";

/**
 * A contact: its side, and how to get away. One beside the robot blocks turning, one ahead or
 * behind blocks driving (robots/agent/safety/contacts.py).
 * @param {string[]} sides of contacts that remain @returns {string} a word, or ""
 */
const touchedWord = (sides) => {
  const has = (/** @type {string} */ side) => sides.includes(side);
  if (has("ahead") && has("behind")) {
    return "alert.touched.ends";
  }
  if (has("left") && has("right")) {
    return "alert.touched.sides";
  }
  // after a contact at a front corner, the robot backs off from both sides
  const [most] = has("behind") ? ["behind"] : sides.filter((side) => side !== "ahead");
  return sides.length ? `alert.touched.${most ?? "ahead"}` : "";
};

/** @param {State} state @returns {Alert} */
const linkAlert = (state) => {
  const { visit, robot, slow, playing, still, stuck } = state;
  const server = serverAlert(state);
  if (server?.word === "alert.server_driver") {
    return server;
  }
  if (visit.sfuLost) {
    return { word: "alert.sfu_lost", tone: "busy" };
  }
  if (visit.link === "lost" && !(slow && playing)) {
    const isDriver = visit.phase === "driving";
    return { word: isDriver ? "alert.link_driver" : "alert.link_observer", tone: "busy" };
  }
  if (robot?.cameraStatus?.reason && playing) {
    return { word: "alert.camera", tone: "danger" };
  }
  if (still) {
    return { word: "alert.link_observer", tone: "busy" };
  }
  return stuck ? null : server;
};

/**
 * A request that the server has just denied, until the next one.
 * @param {State} state @returns {Alert}
 */
const denialAlert = ({ denial, visit, now, said, barred, task, release }) => {
  if (!denial || now >= denial.until || !isUnsettled(denial.word, visit)) {
    return null;
  }
  const others = [said?.at, barred?.at, task?.askedAt, release?.since];
  return others.some((at) => at !== undefined && at > denial.at)
    ? null
    : { word: denial.word, tone: "busy" };
};

/** @param {State} state @returns {Alert} */
const slowAlert = ({ visit, roundTrip, stuck }) =>
  !stuck && visit.phase === "driving" && roundTrip !== null && roundTrip > SLOW_SECONDS
    ? { word: "alert.slow", tone: "busy" }
    : null;

/**
 * The newest answer to the visitor's input.
 * @param {State} state @returns {Alert}
 */
const answerAlert = (state) => {
  const { barred, said, now } = state;
  if (barred && now - barred.at < READING_SECONDS && !(said && said.at > barred.at)) {
    return { word: `off.${barred.method}`, tone: "busy" };
  }
  return said && isAnswered(state) ? { ...said, tone: "calm" } : null;
};

/**
 * Why the robot does not do what its driver wants.
 * @param {State} state @returns {Alert}
 */
const helpAlert = (state) => {
  const { visit, robot, help, now, pushedAt, stuck, releasedAt } = state;
  if (visit.phase === "driving" && robot.docked && now - pushedAt < READING_SECONDS) {
    const word = wayOut(state) ? "alert.docked_forward" : "alert.docked_forward_yourself";
    return { word, tone: "busy" };
  }
  if (visit.phase === "driving" && now - releasedAt < READING_SECONDS) {
    return { word: "alert.released", tone: "calm" };
  }
  const word = visit.phase === "driving" ? wordOf(help) : "";
  if (word && (profileOf(state).explains || NEEDED.has(help.why))) {
    return { word, tone: help.why === "blind" ? "busy" : "calm" };
  }
  return stuck ? { ...stuck, tone: "busy" } : null;
};

/** @param {State} state @returns {Alert} */
const lostAlert = ({ robot }) =>
  robot.pose?.localized === false ? { word: "alert.lost", tone: "busy" } : null;

/** @param {State} state @returns {Alert} */
const quietAlert = ({ visit, notice, now, slow, playing, progress, practising }) => {
  // a task shows the time left itself, and so does the page around a practice drive
  if (visit.turnEnds !== null && (progress?.endsAt ?? null) === null && !practising) {
    const time = clockTime(Math.max(0, Math.ceil(visit.turnEnds - now)));
    const word = visit.turnReason ? "alert.maintenance" : "alert.turn_ends";
    return { word, tone: "busy", values: { time } };
  }
  if (notice) {
    return { word: "alert.notice", tone: "calm", values: { text: notice } };
  }
  const word = visit.phase === "driving" ? "alert.slow_picture" : "alert.slow_picture_observer";
  return slow && playing ? { word, tone: "calm" } : null;
};
