/** What the light pages share: an element that the page has, and a request every few seconds. */

/**
 * The first element that matches; its kind is known to the template.
 * @param {string} selector
 * @param {ParentNode} [root]
 * @returns {any}
 */
export const find = (selector, root = document) => root.querySelector(selector);

/**
 * Call `refresh` now and `period` ms after each call has ended, while the page is visible.
 * @param {() => Promise<unknown>} refresh
 * @param {number} period ms
 */
export const pollWhileVisible = (refresh, period) => {
  let timer = 0;
  const run = async () => {
    clearTimeout(timer);
    if (document.hidden) {
      return;
    }
    await refresh();
    clearTimeout(timer);
    timer = window.setTimeout(run, period);
  };
  document.addEventListener("visibilitychange", run);
  timer = window.setTimeout(run, period);
};
