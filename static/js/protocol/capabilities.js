/**
 * What a study leaves to the visitor: what it fixes is not offered. Pure. The terms of the visit
 * come with the grant; until then what the page was told about the study holds
 * (experiments/participation/drive_config.py). Without a study everything is open.
 */

/** What may steer, null when everything may. @param {State} state @returns {string[] | null} */
export const controllersOf = ({ visit, study }) => (visit.terms ?? study)?.controllers ?? null;

/** @param {State} state @param {string} method */
export const maySteer = (state, method) => controllersOf(state)?.includes(method) ?? true;

/**
 * Whether the robot may be asked for this type of action.
 * @param {State} state @param {string} type
 */
export const mayAsk = ({ visit, study }, type) =>
  (visit.terms ?? study)?.actions?.includes(type) ?? true;

/**
 * Whether the robot is sent by places, or by a point of the map: to the robot both are the same.
 * @param {State} state @param {"places" | "map"} by
 */
export const maySend = ({ study }, by) => study?.ownActions.includes(by) ?? true;

/** Whether somebody else has chosen how much the robot helps. @param {State} state */
export const isAssistFixed = ({ visit, study }) => Boolean((visit.terms ?? study)?.assist);
