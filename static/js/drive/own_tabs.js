/**
 * Which pages of this browser drive a robot: each holds a lock with the robot's name, which the
 * browser releases when the page is closed.
 */

/** @param {string} robot @param {LockManager | null | undefined} locks absent without HTTPS */
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
        // Shared: while a drive moves from one page to the other, both hold it.
        over = locks.request(name, { mode: "shared" }, () => held).then(() => {});
      }
    },
    /** Where the visitor drives on another page. @returns {Promise<"" | "browser" | "device">} */
    find: async () => {
      await over;
      const held = (await locks?.query())?.held;
      return held ? (held.some((lock) => lock.name === name) ? "browser" : "device") : "";
    },
  };
};
