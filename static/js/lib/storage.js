/**
 * What a browser stores: for a tab its session, over a reload; for each person the profile, the
 * keys and whether a hint was used. Another tab of the same visitor does not see the session. A
 * duplicated tab gets a copy, but without the note that this very page has just been left, which
 * allows the page to take the session back without asking.
 */

/** @param {string} robot @param {string} session */
export const remember = (robot, session) => write(robot, { session });

/** @param {string} robot */
export const forget = (robot) => attempt(() => sessionStorage.removeItem(`visit:${robot}`));

/** Notes for a reload that the page was left. @param {string} robot */
export const rememberLeaving = (robot) => {
  const { session } = read(robot);
  if (session) {
    write(robot, { session, left: true });
  }
};

/**
 * Returns the stored session, and deletes the mark that the page was left: it holds for one load.
 * @param {string} robot @returns {{session: string | null, left: boolean}}
 */
export const recall = (robot) => {
  const { session, left } = read(robot);
  if (session) {
    remember(robot, session);
  }
  return { session, left };
};

/**
 * The profile that a person chose in this browser (view/display/profiles.js), in all its tabs.
 * @param {string} who @returns {string | null}
 */
export const recallProfile = (who) => attempt(() => localStorage.getItem(`profile:${who}`)) ?? null;

/** @param {string} who @param {string} name */
export const rememberProfile = (who, name) =>
  attempt(() => localStorage.setItem(`profile:${who}`, name));

/**
 * The keys that a person chose in this browser (input/keymap.js), by command.
 * @param {string} who @returns {Record<string, string[]>}
 */
export const recallKeys = (who) => {
  const own = attempt(() => JSON.parse(localStorage.getItem(`keys:${who}`) ?? "{}")) ?? {};
  const isList = (/** @type {unknown} */ keys) =>
    Array.isArray(keys) && keys.every((key) => typeof key === "string");
  return Object.fromEntries(Object.entries(own).filter(([, keys]) => isList(keys)));
};

/** @param {string} who @param {Record<string, string[]>} own */
export const rememberKeys = (who, own) =>
  attempt(() => localStorage.setItem(`keys:${who}`, JSON.stringify(own)));

/**
 * Whether a person has used a point of the map in this browser (autonomy/map_bar.js).
 * @param {string} who
 */
export const recallAimed = (who) => attempt(() => localStorage.getItem(`aimed:${who}`)) === "yes";

/** @param {string} who */
export const rememberAimed = (who) => attempt(() => localStorage.setItem(`aimed:${who}`, "yes"));

/** @param {string} robot @returns {{session: string | null, left: boolean}} */
const read = (robot) => {
  const { session, left } =
    attempt(() => JSON.parse(sessionStorage.getItem(`visit:${robot}`) ?? "{}")) ?? {};
  return typeof session === "string"
    ? { session, left: left === true }
    : { session: null, left: false };
};

/** @param {string} robot @param {object} value */
const write = (robot, value) =>
  attempt(() => sessionStorage.setItem(`visit:${robot}`, JSON.stringify(value)));

/**
 * Uses the browser's storage, which may be forbidden, full or corrupt.
 * @template T
 * @param {() => T} what @returns {T | undefined} undefined where that failed
 */
export const attempt = (what) => {
  try {
    return what();
  } catch (error) {
    if (error instanceof SyntaxError || error instanceof DOMException) {
      return undefined;
    }
    throw error;
  }
};
