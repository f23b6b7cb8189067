/**
 * Rarely needed parts of the drive page: calling a waiting visitor, practising, problems of the
 * connection, and browsers without live video.
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
  const { store, config, words, element, begin } = page;
  const { report } = page.connection;
  const { visit } = store.get();
  const practice = createPractice({ store, address: config.practice, element, words, report });
  return {
    ...practice,
    /** @param {string} word */
    call: (word) => call(words.say(`${word}.title`), words.say(`${word}.text`)),
    prepare,
    waits: () => store.update({ notifiable: permission() === "default" }),
    tell_me: async () => store.update({ notifiable: (await askPermission()) === "default" }),
    examine: async () => {
      const connected = () => store.get().visit.socket === "open";
      const { iceServers } = store.get().visit;
      const { advice, record } = await examine({ socket: config.check, iceServers, connected });
      store.update({ finding: connected() && isRobotsFault(store.get()) ? null : advice });
      report("check", record);
    },
    /** Says that this browser has no live video. */
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
    /** Continues with frames through the server. */
    go_slow: () => {
      store.update({ visit });
      begin();
    },
  };
};
