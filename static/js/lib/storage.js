/**
 * What a browser remembers: of a tab its session, over a reload, and of a person the profile, the
 * keys and a used hint of the page. Another tab of the same visitor does not see the session; a
 * duplicated tab gets a copy, but never one that says "this very page has just been left", which is
 * what allows to take the session back without asking.
 */

/** @param {string} robot */
const keyOf = (robot) => `visit:${robot}`;

/** @param {string} robot @param {string} session */
export const remember = (robot, session) => write(robot, { session });

/** @param {string} robot */
export const forget = (robot) => write(robot, null);

/** The page is being left; a reload will find this. @param {string} robot */
export const rememberLeaving = (robot) => {
  const { session } = read(robot);
  if (session) {
    write(robot, { session, left: true });
  }
};

/**
 * What there is, and forget that the page was left: that is true for one load only.
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
    attempt(() => JSON.parse(sessionStorage.getItem(keyOf(robot)) ?? "{}")) ?? {};
  return typeof session === "string"
    ? { session, left: left === true }
    : { session: null, left: false };
};

/** @param {string} robot @param {object | null} value */
const write = (robot, value) =>
  attempt(() =>
    value === null
      ? sessionStorage.removeItem(keyOf(robot))
      : sessionStorage.setItem(keyOf(robot), JSON.stringify(value)),
  );

/**
 * Storage may be forbidden, full or corrupt; then a reload starts afresh.
 * @template T
 * @param {() => T} what @returns {T | undefined}
 */
const attempt = (what) => {
  try {
    return what();
  } catch (error) {
    if (error instanceof SyntaxError || error instanceof DOMException) {
      return undefined;
    }
    throw error;
  }
};
