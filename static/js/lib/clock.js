/**
 * The page's clock: Unix time in seconds that never steps back while the page lives, unlike
 * Date.now().
 * @returns {number}
 */
export const unixNow = () => (performance.timeOrigin + performance.now()) / 1000;

/** Minutes and seconds, such as 2:05. @param {number} seconds */
export const clockTime = (seconds) =>
  `${Math.floor(seconds / 60)}:${String(Math.floor(seconds % 60)).padStart(2, "0")}`;
