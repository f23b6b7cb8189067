/**
 * Profiles of the page: what it shows and explains, and the speed and assistance at the start of a
 * drive. Pure. The names are those of sessions/interfaces.py and static/css/profiles.css. Every
 * profile shows why a robot does not move.
 */

import { isAssistFixed, offersAssist } from "../../protocol/capabilities.js";

/**
 * @typedef {object} Profile
 * @property {number} step at the start, index into input/speeds.js STEPS
 * @property {string | null} assist level of assistance at the start, null: the owner's
 * @property {boolean} explains whether the page explains what assistance does
 * @property {boolean | null} laser whether laser points are drawn, null: by the level of assistance
 * @property {boolean} figures whether figures of the connection are shown
 */

/** @type {Record<string, Profile>} */
export const PROFILES = {
  standard: { step: 1, assist: null, explains: true, laser: null, figures: false },
  novice: { step: 0, assist: "steer", explains: true, laser: false, figures: false },
  expert: { step: 2, assist: "slow", explains: false, laser: null, figures: false },
  technical: { step: 1, assist: "off", explains: false, laser: true, figures: true },
};
const FIRST = "standard";

/** @param {any} name */
const known = (name) => (Object.hasOwn(PROFILES, name) ? name : FIRST);

/**
 * The profile that the owner or a study fixes, null without one.
 * @param {State} state @returns {string | null}
 */
export const fixedProfile = ({ visit, study }) => (visit.terms ?? study)?.interface || null;

/**
 * The profile in force; an unknown one counts as the first.
 * @param {State} state @returns {string}
 */
export const nameOf = (state) => known(fixedProfile(state) ?? state.profile);

/** @param {State} state */
export const profileOf = (state) => PROFILES[nameOf(state)];

/**
 * Speed and assistance at the start of a drive; null keeps the assistance.
 * @param {State} state @param {boolean} isContinued after a reload
 * @returns {{step: number, assist: string | null}}
 */
export const beginningOf = (state, isContinued) => {
  const { step, assist } = profileOf(state);
  const mayChange = !isContinued && offersAssist(state.factsheet) && !isAssistFixed(state);
  return { step, assist: mayChange ? assist : null };
};
