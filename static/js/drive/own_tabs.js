/**
 * Which pages of this browser drive a robot: each holds a lock of its name, which the browser takes
 * from a page that is gone.
 */

/**
 * @param {string} robot
 * @param {LockManager | null | undefined} locks absent where the page did not come by HTTPS
 */
export const newOwnTabs = (robot, locks = navigator.locks) => {
  const name = `drive:${robot}`;
  let release = () => {};
  let over = Promise.resolve();
  return {
    /** @param {boolean} drives whether this page does, from now on */
    mark: (drives) => {
      release();
      if (drives && locks) {
        const held = new Promise((done) => (release = () => done(null)));
        // Two for a moment, while a drive moves from one page to the other.
        over = locks.request(name, { mode: "shared" }, () => held).then(() => {});
      }
    },
    /**
     * Where another page of the visitor's is that drives.
     * @returns {Promise<"" | "browser" | "device">}
     */
    find: async () => {
      await over;
      const held = (await locks?.query())?.held;
      return held ? (held.some((lock) => lock.name === name) ? "browser" : "device") : "";
    },
  };
};
