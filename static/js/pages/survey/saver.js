/**
 * Sends answers one after the other, the newest of each question only, and again until they arrive.
 * What has not arrived is kept in the tab's own storage, so that a reload without network loses
 * nothing.
 *
 * @typedef {"idle" | "saving" | "saved" | "waiting" | "refused"} State
 *
 * @typedef {object} Outcome
 * @property {boolean} ok
 * @property {boolean} final do not try again by yourself
 * @property {boolean} [keep] it may be taken another time, from somebody who has signed in again
 * @property {string} [error]
 */

const FIRST_WAIT_MS = 1000;
const LONGEST_WAIT_MS = 15000;

/**
 * @param {object} parts
 * @param {(key: string, fields: [string, string][]) => Promise<Outcome>} parts.send resolves in any
 *   case
 * @param {(state: State, key: string, error: string) => void} parts.tell
 * @param {Storage} parts.storage
 * @param {string} parts.name under which unsent answers are kept
 * @param {(run: () => void, ms: number) => unknown} parts.later
 */
export const createSaver = ({ send, tell, storage, name, later }) => {
  /** @type {Map<string, [string, string][]>} */
  const unsent = new Map(JSON.parse(storage.getItem(name) ?? "[]"));
  let busy = false;
  let wait = 0;

  const keep = () =>
    unsent.size ? storage.setItem(name, JSON.stringify([...unsent])) : storage.removeItem(name);

  const next = async () => {
    const first = unsent.entries().next();
    if (busy || first.done) return;
    const [key, fields] = first.value;
    busy = true;
    tell("saving", key, "");
    const { ok, final, keep: isKept = false, error = "" } = await send(key, fields);
    busy = false;
    if (!ok && !final) return tryAgain(key);
    if (!ok && isKept) return tell("refused", key, error);
    // A newer answer to the same question may have come in the meantime: it is still to be sent.
    if (unsent.get(key) === fields) unsent.delete(key);
    keep();
    wait = 0;
    tell(ok ? "saved" : "refused", key, error);
    return next();
  };

  /** @param {string} key */
  const tryAgain = (key) => {
    tell("waiting", key, "");
    wait = Math.min(LONGEST_WAIT_MS, wait === 0 ? FIRST_WAIT_MS : 2 * wait);
    later(() => void next(), wait);
  };

  return {
    /** @param {string} key @param {[string, string][]} fields */
    save: (key, fields) => {
      unsent.delete(key);
      unsent.set(key, fields);
      keep();
      return next();
    },
    /** Send what an earlier load of this page left behind, or what waits for the network. */
    resume: () => {
      wait = 0;
      return next();
    },
    unsent: () => new Map(unsent),
    forget: () => {
      unsent.clear();
      keep();
    },
  };
};
