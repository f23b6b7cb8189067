/**
 * What the robot is asked to do by itself, from the visitor's wish to its end. Pure: it makes messages and reads answers, console.js
 * carries them.
 *
 * An order is said again, under the same id, until the robot answers; one that finds no answer has failed. What has ended stays for a
 * moment, so that it can be read; what has failed stays until the visitor does something.
 */

export const AGAIN_SECONDS = 0.7;
export const PATIENCE_SECONDS = 3; // the robot refuses what is older
export const READING_SECONDS = 5;

/** Refusals of the first moment after a visit began or a connection came back: worth asking again. */
const TOO_EARLY = new Set(["clock_unknown", "stale"]);
const MOVES = new Set(["goto", "follow", "dock", "undock"]);
const ENDED = new Set(["FINISHED", "FAILED", "CANCELLED"]);

/**
 * @typedef {object} Task
 * @property {string} id
 * @property {string} type goto, follow, dock, undock or relocalize
 * @property {Record<string, any>} order the fields of the action
 * @property {string} title of the place it goes to, or nothing
 * @property {"ASKED" | "WAITING" | "RUNNING" | "FINISHED" | "FAILED" | "CANCELLED"} status ASKED: not answered yet
 * @property {string} reason the robot's own words
 * @property {number | null} progress 0 to 1, null while unknown
 * @property {number} askedAt Unix seconds
 * @property {number} sentAt
 * @property {number | null} endedAt
 */

/**
 * @param {{type: string, title?: string} & Record<string, any>} wish the action's type and fields, and the name of the place it leads to
 * @param {string} id @param {number} now
 * @returns {Task}
 */
export const ask = ({ type, title = "", ...order }, id, now) => ({
  id,
  type,
  order,
  title,
  status: "ASKED",
  reason: "",
  progress: null,
  askedAt: now,
  sentAt: now,
  endedAt: null,
});

/** The wish that a task came from, to have it once more. @param {Task} task */
export const wishOf = ({ type, title, order }) => ({ type, title, ...order });

/**
 * The action as it is sent.
 * @param {Task} task @param {{session: string, epoch: number}} binding @param {number} now
 */
export const messageOf = ({ id, type, order }, binding, now) => ({ type, actionId: id, stamp: now, ...binding, ...order });

/** @param {Task | null} task */
export const isUnderWay = (task) => task !== null && !ENDED.has(task.status);

/** Whether the robot moves by itself for it. @param {Task | null} task */
export const isMoving = (task) => isUnderWay(task) && MOVES.has(/** @type {Task} */ (task).type);

/**
 * News of an action. What this page did not ask for, but runs (it was reloaded meanwhile), becomes its task.
 * @param {Task | null} task
 * @param {{actionId: string, status: string, type: string, reason: string, result: Record<string, any>}} news
 * @param {number} now
 * @returns {Task | null}
 */
export const heard = (task, news, now) => {
  if (task?.id !== news.actionId) {
    const runs = MOVES.has(news.type) && news.status === "RUNNING" && !isUnderWay(task);
    return runs ? heard({ ...ask({ type: news.type }, news.actionId, now), status: "WAITING" }, news, now) : task;
  }
  if (ENDED.has(task.status) || (task.status === "ASKED" && news.status === "FAILED" && TOO_EARLY.has(news.reason))) {
    return task;
  }
  const progress = typeof news.result.progress === "number" ? Math.min(1, Math.max(0, news.result.progress)) : task.progress;
  const status = /** @type {Task["status"]} */ (news.status);
  return { ...task, status, reason: news.reason, progress, endedAt: ENDED.has(status) ? now : null };
};

/**
 * What time does to a task: an order without an answer is due again, or has failed; what was read goes away.
 * @param {Task | null} task @param {number} now
 * @returns {{task: Task | null, send: boolean}}
 */
export const pass = (task, now) => {
  if (task?.status === "ASKED" && now - task.askedAt > PATIENCE_SECONDS) {
    return { task: { ...task, status: "FAILED", reason: "no_answer", endedAt: now }, send: false };
  }
  if (task?.status === "ASKED" && now - task.sentAt > AGAIN_SECONDS) {
    return { task: { ...task, sentAt: now }, send: true };
  }
  const read = task !== null && task.endedAt !== null && task.status !== "FAILED" && now - task.endedAt > READING_SECONDS;
  return { task: read ? null : task, send: false };
};
