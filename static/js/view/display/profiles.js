/**
 * Profiles of the page: what it shows, how much it explains, and with which speed and assistance a
 * drive begins. Pure. The names are those of sessions/interfaces.py; static/css/profiles.css hides
 * by them too. Why a robot that ought to move does not is said in every one.
 */

import { isAssistFixed, offersAssist } from "../../protocol/capabilities.js";

/**
 * @typedef {object} Profile
 * @property {number} step index into input/speeds.js STEPS to begin with
 * @property {string | null} assist level of assistance to begin with, null leaves it as the robot's
 *   owner has it
 * @property {boolean} explains whether it is told what the robot does to help
 * @property {boolean | null} laser whether laser points are drawn, null leaves it to the level of
 *   assistance
 * @property {boolean} figures whether the connection is shown in figures
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
 * The name of what is in force. One that a page does not know shows as the first, and is told as
 * that.
 * @param {State} state @returns {string}
 */
export const nameOf = (state) => known(fixedProfile(state) ?? state.profile);

/** @param {State} state */
export const profileOf = (state) => PROFILES[nameOf(state)];

/**
 * What a drive begins with. One that only goes on keeps the assistance that the server knows of it.
 * @param {State} state
 * @param {boolean} again whether the drive continues after a reload
 * @returns {{step: number, assist: string | null}} assist null leaves it as it is
 */
export const beginningOf = (state, again) => {
  const { step, assist } = profileOf(state);
  return {
    step,
    assist: !again && offersAssist(state.factsheet) && !isAssistFixed(state) ? assist : null,
  };
};
