/**
 * A part of the page that is fetched when it is first needed, and then is `now`. If the network is
 * unavailable, the next need fetches it again.
 * @template T
 * @param {() => Promise<T>} fetch
 */
export const lazy = (fetch) => {
  /** @type {Promise<T> | undefined} */
  let coming;
  const part = Object.assign(
    (/** @type {(it: T) => void} */ use, missing = () => {}) => {
      coming ??= fetch();
      coming.then(
        (it) => {
          part.now = it;
          use(it);
        },
        () => {
          coming = undefined;
          missing();
        },
      );
    },
    { now: /** @type {T | null} */ (null) },
  );
  return part;
};
