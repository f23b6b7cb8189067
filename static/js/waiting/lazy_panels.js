/**
 * What the drive page needs only now and then, fetched when it does: calling a visitor who waits,
 * practising meanwhile, saying what is wrong with the connection, and the way out of browsers that
 * have no live video.
 */

import { examine } from "../pages/check/examine.js";
import { copy } from "../lib/clipboard.js";
import { appOf, browserFor } from "../pages/check/in_app.js";
import { isRobotsFault } from "./fault.js";
import { createFreeRobots } from "./free_robots.js";
import { askPermission, call, permission, prepare } from "./notification.js";
import { createPractice } from "./practice.js";
import { saveSouvenir } from "./souvenir.js";

/** @param {Page} page */
export const createLazyPanels = (page) => {
  const {
    store,
    config,
    words,
    element,
    connection: { report },
    begin,
  } = page;
  const { visit } = store.get();
  const practice = createPractice({ store, address: config.practice, element, words, report });
  return {
    ...practice,
    /** @param {string} word */
    call: (word) => call(words.say(`${word}.title`), words.say(`${word}.text`)),
    /** Have what calls ready; within a touch. */
    prepare,
    /** The visitor waits from now on. */
    waits: () => store.update({ notifiable: permission() === "default" }),
    tell_me: async () => store.update({ notifiable: (await askPermission()) === "default" }),
    examine: async () => {
      const connected = () => store.get().visit.socket === "open";
      const { advice, record } = await examine({
        socket: config.check,
        iceServers: store.get().visit.iceServers,
        connected,
      });
      store.update({ finding: connected() && isRobotsFault(store.get()) ? null : advice });
      report("check", record);
    },
    /** This browser has no live video: say so, and where there is some. */
    explain: () => {
      const reason = appOf(navigator.userAgent) ? "in_app" : "unsupported";
      store.update({
        betterBrowser: browserFor(navigator.userAgent),
        visit: { ...visit, phase: "closed", reason },
      });
    },
    /** @param {number} now */
    look_for_free_robots: createFreeRobots(page),
    copy_link: async () => store.update({ copied: await copy(location.href) }),
    souvenir: async () => {
      const { trip } = store.get();
      if (trip) {
        await saveSouvenir(page, trip);
      }
    },
    /** Go on with pictures through the server. */
    go_slow: () => {
      store.update({ visit });
      begin();
    },
  };
};
