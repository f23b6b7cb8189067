/**
 * Seconds of attention for each question: the time from one touch of the page to the next counts
 * for the question that is touched next, as it was read before. Time while the page is hidden does
 * not count.
 */

/** @param {() => number} now seconds on a clock that never goes back */
export const createAttention = (now) => {
  /** @type {Map<string, number>} */
  const seconds = new Map();
  let before = 0; // s since the last touch, until the page was hidden
  /** @type {number | null} the start of the present stretch, null while hidden */
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
