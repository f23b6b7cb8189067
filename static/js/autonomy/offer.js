/**
 * Decides the text and buttons of the small panel at the foot of the video: what the robot does by
 * itself, or could do now. Pure; rendered by offer_panel.js.
 */

import { isHeld, releaseOf } from "../protocol/estop_release.js";
import { roleOf } from "../protocol/session.js";
import { isMoving, isUnderWay } from "../protocol/robot_action.js";
import { can, controllersOf, mayAsk, maySteer } from "../protocol/capabilities.js";
import { reasonFor } from "./reasons.js";
import { reports, standstillOf } from "../protocol/standstill.js";

/**
 * @typedef {object} Offer
 * @property {string} word its sentence
 * @property {Record<string, string>} [values]
 * @property {{word: string, values?: Record<string, string>} | null} [detail] a second sentence
 * @property {"calm" | "busy" | "danger"} tone
 * @property {number | null} [progress] 0 to 1
 * @property {{action: string, word: string}} [main]
 * @property {{action: string, word: string}} [other]
 */

/** It stops the robot; only the red button is called Stop. */
const CANCEL = { action: "stop", word: "do.cancel_drive" };
const RELEASE = { action: "release_stop", word: "do.release_stop" };
const AGAIN = { action: "task_again", word: "do.task_again" };
const SELF = { action: "task_dismiss", word: "do.drive_yourself" };
/** Words for the release of a stop between sessions, which no button on the robot has pressed. */
const HELD = { offered: "held", asked: "asked", failed: "held_failed" };

/**
 * The action of the button that leaves the dock: the robot's own, or backwards, steered by the
 * page. Where a study forbids the first there is no button, except for visitors who can only press
 * on the video, which does not show the floor behind the robot.
 * @param {State} state @returns {"undock" | "back_out" | null}
 */
export const wayOut = (state) => {
  if (can(state, "undock")) {
    return "undock";
  }
  const onlyPoints =
    !maySteer(state, "stick") && (maySteer(state, "mouse") || maySteer(state, "touch"));
  return mayAsk(state, "undock") || onlyPoints ? "back_out" : null;
};

/**
 * Whether this visitor's robot leaves its dock by itself: not where the visitor steers nothing, and
 * a hidden operator decides.
 * @param {State} state
 */
export const setsOut = (state) =>
  state.robot?.docked && wayOut(state) === "undock" && controllersOf(state)?.length !== 0;

/** @param {State} state @returns {Offer | null} */
const inStation = (state) => {
  const action = wayOut(state);
  const { visit, arrival } = state;
  const isDecided = arrival?.session === visit.session && arrival.isOver;
  if (visit.session && setsOut(state) && !isDecided) {
    return null; // it may leave by itself in a moment
  }
  if (action) {
    return { word: "dock.here", tone: "calm", main: { action, word: "do.undock" } };
  }
  return controllersOf(state)?.length === 0 ? null : { word: "dock.here_yourself", tone: "calm" };
};

/**
 * An operator's offer to release the robot's emergency stop, or a stop between sessions; null
 * without one.
 * @param {State} state @returns {{word: string, main?: {action: string, word: string}} | null}
 */
export const releaseFor = ({ operates, robot, room, release, now }) => {
  const held = isHeld(robot, room.driver);
  if (!operates || !(robot?.safety.estop || held)) {
    return null;
  }
  const asked = releaseOf(release, now);
  const what = held ? HELD[asked] : asked;
  return { word: `release.${what}`, main: what === "asked" ? undefined : RELEASE };
};

/** @param {State} state @returns {Offer | null} */
export const offerFor = (state) => {
  const release = roleOf(state.visit) ? releaseFor(state) : null;
  return release ? { ...release, tone: "danger" } : isFree(state) ? FREE : usualOffer(state);
};

const FREE = /** @type {const} */ ({
  word: "watch.free",
  tone: "calm",
  main: { action: "drive", word: "do.drive" },
});

/** Whether this visitor watches a robot that they could drive at once. @param {State} state */
const isFree = ({ visit, room, robot }) =>
  visit.phase === "watching" &&
  visit.mayDrive &&
  visit.online &&
  !(room.driving || room.driver || room.waiting || room.pause) &&
  standstillOf(robot) === "";

/** @param {State} state @returns {Offer | null} */
const usualOffer = (state) => {
  const { visit, robot, task } = state;
  if (
    roleOf(visit) !== "driver" ||
    !robot ||
    !state.playing ||
    state.leaving ||
    robot.safety.estop ||
    (visit.link === "lost" && !state.slow)
  ) {
    return null;
  }
  if (isUnderWay(task)) {
    return underWay(/** @type {RobotAction} */ (task));
  }
  if (reports(robot, "runs_on") || reports(robot, "cancel")) {
    return null; // the robot may not have stopped, which the end of an action would imply
  }
  if (task?.status === "FAILED") {
    return {
      word: `task.failed.${known(task)}`,
      detail: refusal(task.reason, state.factsheet?.footprint ?? []),
      tone: "danger",
      main: AGAIN,
      other: SELF,
    };
  }
  if (state.maneuver === "back") {
    return { word: "task.undock", detail: { word: "task.take_over" }, tone: "calm", main: CANCEL };
  }
  if (robot.docked) {
    return inStation(state);
  }
  if (state.aim?.kind === "pose") {
    return null; // the map asks
  }
  if (!robot.pose.localized && can(state, "relocalize")) {
    return {
      word: "lost.what",
      tone: "busy",
      main: { action: "show_pose", word: "do.show_pose" },
      other: { action: "search", word: "do.search" },
    };
  }
  return task ? ended(task) : null;
};

/**
 * Whether the answer to the visitor's last input is still shown.
 * @param {Pick<State, "said" | "now">} state
 */
export const isAnswered = ({ said, now }) => said !== null && now < said.until;

/**
 * Why the robot refused. For a point too near to a wall, which the robot could not move by half a
 * metre (robots/agent/navigation/planning), the sentence names the distance that it needs.
 * @param {string} reason @param {Point[]} footprint
 * @returns {{word: string, values?: Record<string, string>} | null}
 */
const refusal = (reason, footprint) => {
  const found = reasonFor(reason);
  return found?.word === "reason.in_wall" && footprint.length
    ? { word: "reason.too_close", values: { cm: String(halfWidth(footprint)) } }
    : found;
};

/** Half the width of a robot, whole cm. @param {Point[]} footprint */
export const halfWidth = (footprint) =>
  Math.ceil(100 * Math.max(0, ...footprint.map(([, y]) => Math.abs(y))));

/** @param {RobotAction} task @returns {string} */
const known = ({ type, title }) =>
  type === "goto" && title
    ? "place"
    : ({ goto: "goto", follow: "goto", dock: "dock", undock: "undock" }[type] ?? "relocalize");

/** @param {RobotAction} task @returns {Offer} */
const underWay = (task) => {
  const moving = isMoving(task);
  const hint = { word: moving ? "task.take_over" : "task.drive_a_little" };
  return {
    word: `task.${known(task)}`,
    values: { place: task.title },
    detail: task.reason ? reasonFor(task.reason) : hint,
    tone: "calm",
    progress: moving ? task.progress : null,
    main: moving ? CANCEL : undefined,
  };
};

/** @param {RobotAction} task @returns {Offer | null} */
const ended = (task) => {
  if (task.status === "FINISHED") {
    const detail = task.reason ? reasonFor(task.reason) : null;
    const values = { place: task.title };
    return { word: `task.done.${known(task)}`, values, detail, tone: "calm" };
  }
  return { word: task.reason === "manual" ? "task.yours" : "task.stopped", tone: "calm" };
};
