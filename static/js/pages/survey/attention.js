/**
 * Seconds of attention a question: the time from one touch of the page to the next belongs to the
 * question that is touched next, because reading it came before. Time while the page is out of
 * sight belongs to none.
 */

/** @param {() => number} now seconds on a clock that never goes back */
export const createAttention = (now) => {
  /** @type {Map<string, number>} */
  const seconds = new Map();
  /**
   * Seconds of a stretch that a change of visibility cut off, and when the present stretch began;
   * null while out of sight.
   */
  let before = 0;
  /** @type {number | null} */
  let since = now();

  const spent = () => before + (since === null ? 0 : now() - since);

  return {
    /** @param {string} key */
    touch: (key) => {
      seconds.set(key, (seconds.get(key) ?? 0) + spent());
      before = 0;
      if (since !== null) since = now();
    },
    /** @param {boolean} seen */
    setSeen: (seen) => {
      if (seen === (since !== null)) return;
      before = spent();
      since = seen ? now() : null;
    },
    /** @param {string} key */
    of: (key) => seconds.get(key),
    all: () => Object.fromEntries(seconds),
  };
};
