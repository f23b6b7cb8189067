/**
 * The page's clock: Unix time in seconds that never steps back while the page lives, unlike
 * Date.now().
 * @returns {number}
 */
export const unixNow = () => (performance.timeOrigin + performance.now()) / 1000;
