/**
 * The delivery of a message to the people at the robot: sent, shown, read aloud. Pure. Each stage
 * is confirmed: the first by the robot, the others by its display, when the message was visible and
 * was read to its end.
 */

import { ask, heard, pass, wishOf } from "../protocol/robot_action.js";

/** s after which a missing receipt, which a lost connection may have lost, is requested */
export const ASKED_AGAIN = [5, 15, 45];
export const DOUBT = 8; // s until the page says that no display has shown a message

const RANK = { sending: 0, failed: 0, sent: 0, shown: 1, not_spoken: 2, spoken: 3 };

/**
 * @typedef {object} Delivery
 * @property {RobotAction} action the `say`
 * @property {"sending" | "failed" | "sent" | "shown" | "not_spoken" | "spoken"} stage
 * @property {boolean} receipts whether this robot sends receipts; an older one does not
 * @property {number} sentAt when the robot confirmed it, Unix seconds
 * @property {number} asks how often its receipt was requested
 */

/** @param {RobotAction} action @returns {Delivery} */
export const newDelivery = (action) => ({
  action,
  stage: "sending",
  receipts: false,
  sentAt: 0,
  asks: 0,
});

/** @param {Delivery} delivery @param {number} now @returns {Delivery} */
const arrived = (delivery, now) =>
  isUnconfirmed(delivery) ? { ...delivery, stage: "sent", sentAt: now } : delivery;

/** @param {Delivery} delivery */
const isUnconfirmed = ({ stage }) => stage === "sending" || stage === "failed";

/**
 * The robot's answer to the `say`.
 * @param {Delivery} delivery @param {Parameters<typeof heard>[1]} news @param {number} now
 * @returns {Delivery}
 */
export const onAnswer = (delivery, news, now) => {
  if (delivery.stage !== "sending") {
    return news.status === "FINISHED" ? arrived(delivery, now) : delivery;
  }
  const action = heard(delivery.action, news, now) ?? delivery.action;
  const next = { ...delivery, action };
  return action.status === "FINISHED"
    ? arrived(next, now)
    : action.status === "FAILED"
      ? { ...next, stage: "failed" }
      : next;
};

/**
 * The robot passes the message on to its displays.
 * @param {Delivery} delivery @param {{receipts: boolean}} words @param {number} now
 * @returns {Delivery}
 */
export const onWords = (delivery, { receipts }, now) => ({ ...arrived(delivery, now), receipts });

/**
 * @param {Delivery} delivery @param {"shown" | "not_spoken" | "spoken"} state @param {number} now
 * @returns {Delivery}
 */
export const onReceipt = (delivery, state, now) => {
  const next = arrived(delivery, now);
  return RANK[state] > RANK[next.stage] ? { ...next, stage: state } : next;
};

/** Whether another receipt may follow. @param {Delivery} delivery */
const isOpen = ({ stage, receipts, action }) =>
  receipts && (stage === "sent" || (stage === "shown" && action.fields.aloud === true));

/**
 * The delivery after a time: without an answer the request is repeated, or has failed; a missing
 * receipt is requested.
 * @param {Delivery} delivery @param {number} now @returns {{delivery: Delivery, send: boolean}}
 */
export const onTime = (delivery, now) => {
  if (delivery.stage === "sending") {
    const { action, send } = pass(delivery.action, now);
    if (!action || action === delivery.action) {
      return { delivery, send };
    }
    const stage = action.status === "FAILED" ? "failed" : "sending";
    return { delivery: { ...delivery, action, stage }, send };
  }
  if (isOpen(delivery) && now - delivery.sentAt > (ASKED_AGAIN[delivery.asks] ?? Infinity)) {
    return { delivery: { ...delivery, asks: delivery.asks + 1 }, send: true };
  }
  return { delivery, send: false };
};

/**
 * Sends a failed one again: under its id, so that it is said only once if the robot has it.
 * @param {Delivery} delivery @param {number} now @returns {Delivery}
 */
export const retry = ({ action, ...delivery }, now) => ({
  ...delivery,
  action: ask(wishOf(action), action.id, now),
  stage: "sending",
});

/**
 * The key of its sentence.
 * @param {Delivery} delivery
 * @param {number} screens connected displays of the robot
 * @param {number} now
 */
export const lineFor = (delivery, screens, now) => {
  if (delivery.stage === "sent" && delivery.receipts && now - delivery.sentAt > DOUBT) {
    return screens > 0 ? "said.unconfirmed" : "said.no_screen";
  }
  return `said.${delivery.stage}`;
};
