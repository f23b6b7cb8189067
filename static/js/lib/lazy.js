/**
 * A part of the page that is fetched when it is first needed. The network may be away just then:
 * the next need fetches it again.
 * @template T
 * @param {() => Promise<T>} fetch
 * @returns {(use: (it: T) => void, missing?: () => void) => void} `missing` is called when it could
 *   not be fetched
 */
export const lazy = (fetch) => {
  /** @type {Promise<T> | undefined} */
  let coming;
  return (use, missing = () => undefined) => {
    coming ??= fetch();
    coming.then(use, () => {
      coming = undefined;
      missing();
    });
  };
};
