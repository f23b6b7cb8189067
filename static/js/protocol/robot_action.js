/**
 * An action of the robot, from the request to its end. Pure.
 *
 * A request is repeated under the same id until the robot answers; without an answer it has failed.
 * Its end is shown for a moment, a failure until the visitor does something.
 */

export const AGAIN_SECONDS = 0.7;
export const PATIENCE_SECONDS = 3; // the robot refuses older requests
export const READING_SECONDS = 5;

/** Refusals just after a session or a connection has started: the request is repeated. */
const TOO_EARLY = new Set(["clock_unknown", "stale"]);
const MOVES = new Set(["goto", "follow", "dock", "undock"]);
const ENDED = new Set(["FINISHED", "FAILED", "CANCELLED"]);

/**
 * @typedef {object} RobotAction
 * @property {string} id
 * @property {string} type goto, follow, dock, undock or relocalize
 * @property {Record<string, any>} fields of the action, by name
 * @property {string} title of the place it goes to, or empty
 * @property {"ASKED" | "WAITING" | "RUNNING" | "FINISHED" | "FAILED" | "CANCELLED"} status ASKED:
 *   not answered yet
 * @property {string} reason as the robot reports it
 * @property {number | null} progress 0 to 1, null while unknown
 * @property {number} askedAt Unix seconds
 * @property {number} sentAt
 * @property {number | null} endedAt
 */

/**
 * @param {{type: string, title?: string} & Record<string, any>} wish the action's type and fields,
 *   and the name of the place it leads to
 * @param {string} id @param {number} now @returns {RobotAction}
 */
export const ask = ({ type, title = "", ...fields }, id, now) => ({
  id,
  type,
  fields,
  title,
  status: "ASKED",
  reason: "",
  progress: null,
  askedAt: now,
  sentAt: now,
  endedAt: null,
});

/** The request for the same action once more. @param {RobotAction} action */
export const wishOf = ({ type, title, fields }) => ({ type, title, ...fields });

/**
 * The action as it is sent.
 * @param {RobotAction} action @param {{session?: string, epoch?: number}} binding
 * @param {number} now
 */
export const messageOf = ({ id, type, fields }, binding, now) => ({
  type,
  actionId: id,
  stamp: now,
  ...binding,
  ...fields,
});

/** @param {RobotAction | null} action */
export const isUnderWay = (action) => action !== null && !ENDED.has(action.status);

/** Whether the robot drives by itself for it. @param {RobotAction | null} action */
export const isMoving = (action) =>
  isUnderWay(action) && MOVES.has(/** @type {RobotAction} */ (action).type);

/**
 * Takes a status. An action that runs since before a reload of the page becomes the page's.
 * @param {RobotAction | null} action
 * @param {ToPage["action"]} news
 * @param {number} now @returns {RobotAction | null}
 */
export const heard = (action, news, now) => {
  if (action?.id !== news.actionId) {
    const runs = MOVES.has(news.type) && news.status === "RUNNING" && !isUnderWay(action);
    return runs
      ? heard({ ...ask({ type: news.type }, news.actionId, now), status: "WAITING" }, news, now)
      : action;
  }
  if (
    ENDED.has(action.status) ||
    (action.status === "ASKED" && news.status === "FAILED" && TOO_EARLY.has(news.reason))
  ) {
    return action;
  }
  const progress =
    typeof news.result.progress === "number"
      ? Math.min(1, Math.max(0, news.result.progress))
      : action.progress;
  return {
    ...action,
    status: news.status,
    reason: news.reason,
    progress,
    endedAt: ENDED.has(news.status) ? now : null,
  };
};

/**
 * The action after a time, and repeats its request when due: call it often.
 * @param {RobotAction | null} action @param {number} now
 * @param {(action: RobotAction) => void} send
 */
export const pursue = (action, now, send) => {
  const next = pass(action, now);
  if (next.send && next.action) {
    send(next.action);
  }
  return next.action;
};

/**
 * The action after a time: without an answer its request is repeated, or has failed; one that has
 * ended is removed.
 * @param {RobotAction | null} action @param {number} now
 * @returns {{action: RobotAction | null, send: boolean}}
 */
export const pass = (action, now) => {
  if (action?.status === "ASKED" && now - action.askedAt > PATIENCE_SECONDS) {
    return {
      action: { ...action, status: "FAILED", reason: "no_answer", endedAt: now },
      send: false,
    };
  }
  if (action?.status === "ASKED" && now - action.sentAt > AGAIN_SECONDS) {
    return { action: { ...action, sentAt: now }, send: true };
  }
  const read =
    action !== null &&
    action.endedAt !== null &&
    action.status !== "FAILED" &&
    now - action.endedAt > READING_SECONDS;
  return { action: read ? null : action, send: false };
};
