/** Robots that a waiting visitor could drive at once, from the landing page's list. */

import { fetchJson } from "../lib/page_poll.js";

const PERIOD = 10; // s between two requests
const MOST = 2;

/**
 * @param {any} list the landing page's
 * @param {string} own the robot that is waited for
 * @param {Words} words @returns {import("../view/hud/card.js").FreeRobot[]}
 */
export const freeRobotsIn = ({ robots }, own, words) =>
  robots
    .filter(
      (/** @type {any} */ { name, state, drives }) =>
        name !== own && state === "available" && drives,
    )
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
      const freeRobots = freeRobotsIn(await fetchJson(config.robots), config.robot, words);
      if (store.get().visit.phase === "queued") {
        store.update({ freeRobots });
      }
    } catch {
      // offline for a moment: requested again
    }
  };

  return (now) => {
    if (config.robots && !document.hidden && now - askedAt >= PERIOD) {
      askedAt = now;
      void ask();
    }
  };
};
