/** What light pages share: the look-up of an element, and a request every few seconds. */

const PATIENCE_MS = 5000;

/**
 * Data from the server.
 * @param {string} url @param {number} [patience] ms
 * @returns {Promise<any>} rejects without an answer in JSON, as when signed out; the error has the
 *   answer's `status`
 */
export const fetchJson = async (url, patience = PATIENCE_MS) => {
  const answer = await fetch(url, {
    headers: { Accept: "application/json" },
    signal: AbortSignal.timeout(patience),
  });
  if (!answer.ok || answer.redirected) {
    throw Object.assign(new Error(`${url}: ${answer.status}`), { status: answer.status });
  }
  return answer.json();
};

/**
 * The first element that matches. The template determines its kind.
 * @param {string} selector @param {ParentNode} [root] @returns {any}
 */
export const find = (selector, root = document) => root.querySelector(selector);

/**
 * While the page is visible, call `refresh` `period` ms from now and after the end of each call,
 * and at once when the page becomes visible.
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
