/**
 * The robots that a visitor who waits could drive at once. The server says in the landing page's
 * list which are free, and how their buttons are called.
 */

const PERIOD = 10; // s between two questions
const MOST = 2;

/**
 * @param {any} list the landing page's
 * @param {string} own the robot that is waited for
 * @param {Words} words @returns {import("../view/hud/card.js").FreeRobot[]}
 */
export const freeRobotsIn = ({ robots }, own, words) =>
  robots
    .filter((/** @type {any} */ { name, state, drives }) => {
      return name !== own && state === "available" && drives;
    })
    .slice(0, MOST)
    .map((/** @type {any} */ { action, url, for_experienced: isHard }) => ({
      action: isHard ? words.say("instead.experienced", { action }) : action,
      url,
    }));

/** @param {Page} page @returns {(now: number) => void} to be called while the visitor waits */
export const createFreeRobots = ({ store, config, words }) => {
  let askedAt = -Infinity;

  const ask = async () => {
    try {
      const answer = await fetch(config.robots, { headers: { Accept: "application/json" } });
      const found = answer.ok ? freeRobotsIn(await answer.json(), config.robot, words) : [];
      if (store.get().visit.phase === "queued") {
        store.update({ freeRobots: found });
      }
    } catch {
      // offline for a moment: asked again
    }
  };

  return (now) => {
    if (config.robots && !document.hidden && now - askedAt >= PERIOD) {
      askedAt = now;
      void ask();
    }
  };
};
