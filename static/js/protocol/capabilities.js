/**
 * What this visitor may request of the robot: its capabilities, within the limits of a study. Pure.
 * The terms of the session arrive with the grant; until then the page's configuration of the study
 * applies (experiments/participation/drive_config.py).
 */

import { roleOf } from "./session.js";

/** The allowed controllers, null for all. @param {State} state @returns {string[] | null} */
export const controllersOf = ({ visit, study }) => (visit.terms ?? study)?.controllers ?? null;

/** @param {State} state @param {string} method */
export const maySteer = (state, method) => controllersOf(state)?.includes(method) ?? true;

/** Whether this type of action may be requested. @param {State} state @param {string} type */
export const mayAsk = ({ visit, study }, type) =>
  (visit.terms ?? study)?.actions?.includes(type) ?? true;

/**
 * Whether a `goto` may be requested by a place, or by a point of the map.
 * @param {State} state @param {"places" | "map"} by
 */
export const maySend = ({ study }, by) => study?.ownActions.includes(by) ?? true;

/** Whether a study fixes the level of assistance. @param {State} state */
export const isAssistFixed = ({ visit, study }) => Boolean((visit.terms ?? study)?.assist);

/**
 * Whether a waiting visitor may write to the people beside the robot: the first in the queue of a
 * robot whose emergency stop is on and that has a display (sessions/consumers/waiting_chat.py).
 * A participant of a study may not.
 * @param {State} state
 */
export const mayWriteWaiting = ({ visit, robot, study, factsheet }) =>
  visit.phase === "queued" &&
  visit.place === 1 &&
  visit.pause === "paused: estop" &&
  !study &&
  (robot?.screens ?? 0) > 0 &&
  Boolean(factsheet?.capabilities?.includes("say"));

/**
 * Whether the robot has a capability, and the visitor may request it.
 * @param {State} state @param {string} capability
 */
export const can = (state, capability) =>
  Boolean(state.factsheet?.capabilities?.includes(capability)) && mayAsk(state, capability);

/**
 * Whether it is offered now: to the driver only.
 * @param {State} state @param {string} capability
 */
export const isOffered = (state, capability) =>
  roleOf(state.visit) === "driver" && can(state, capability);

/**
 * Whether the visitor could hear the robot, and does not: browsers play sound only after a press.
 * @param {State} state
 */
export const offersSound = ({ sound, factsheet }) =>
  !sound && Boolean(factsheet?.capabilities?.includes("audio"));

/** Whether the robot has levels of assistance. @param {any} factsheet */
export const offersAssist = (factsheet) => Boolean(factsheet?.capabilities?.includes("assist"));
