/**
 * A sentence on its way from the chat's field to the people at the robot: sent, shown, read aloud.
 * Decisions only. Every stage is what somebody has confirmed: the robot that it has the sentence,
 * and a page of the robot's screen that it was visible and read to its end.
 */

import { ask, heard, pass, wishOf } from "../protocol/robot_action.js";

/**
 * s after a sentence was sent when the robot is asked what became of it: its receipt may have been
 * lost with the connection
 */
export const ASKED_AGAIN = [5, 15, 45];
/** s until a sentence that no screen has shown says so */
export const DOUBT = 8;

const RANK = { sending: 0, failed: 0, sent: 0, shown: 1, not_spoken: 2, spoken: 3 };

/**
 * @typedef {object} Delivery
 * @property {RobotAction} action the `say`
 * @property {"sending" | "failed" | "sent" | "shown" | "not_spoken" | "spoken"} stage
 * @property {boolean} receipts whether this robot will tell what became of it; an older one never
 *   gets past "sent"
 * @property {number} sentAt when the robot confirmed it, Unix seconds
 * @property {number} asks how often the robot was asked what became of it
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
 * The robot passes the sentence on to its screens.
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

/** Whether something may still become of it. @param {Delivery} delivery */
const isOpen = ({ stage, receipts, action }) =>
  receipts && (stage === "sent" || (stage === "shown" && action.fields.aloud === true));

/**
 * What time does to it: one without an answer is due again, or was not sent; one without a receipt
 * is asked about.
 * @param {Delivery} delivery @param {number} now @returns {{delivery: Delivery, send: boolean}}
 */
export const onTime = (delivery, now) => {
  if (delivery.stage === "sending") {
    const { action, send } = pass(delivery.action, now);
    const failed = action?.status === "FAILED";
    return {
      delivery:
        action === delivery.action || !action
          ? delivery
          : { ...delivery, action, stage: failed ? "failed" : "sending" },
      send,
    };
  }
  if (isOpen(delivery) && now - delivery.sentAt > (ASKED_AGAIN[delivery.asks] ?? Infinity)) {
    return { delivery: { ...delivery, asks: delivery.asks + 1 }, send: true };
  }
  return { delivery, send: false };
};

/**
 * One that was not sent, once more: under its id, so that it is said only once if the robot has it
 * after all.
 * @param {Delivery} delivery @param {number} now @returns {Delivery}
 */
export const retry = ({ action, ...delivery }, now) => ({
  ...delivery,
  action: ask(wishOf(action), action.id, now),
  stage: "sending",
});

/**
 * The key of its line.
 * @param {Delivery} delivery
 * @param {number} screens the robot's displays that are connected
 * @param {number} now
 */
export const lineFor = (delivery, screens, now) => {
  if (delivery.stage === "sent" && delivery.receipts && now - delivery.sentAt > DOUBT) {
    return screens > 0 ? "said.unconfirmed" : "said.no_screen";
  }
  return `said.${delivery.stage}`;
};
