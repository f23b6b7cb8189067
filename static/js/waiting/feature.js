/**
 * Waiting for the robot, and help when there is no connection. All of it is fetched when it is
 * first needed (lazy_panels.js).
 */

import { lazy } from "../lib/lazy.js";
import { roleOf } from "../protocol/session.js";
import { isRobotsFault } from "./fault.js";

const UNREACHED = "check.server.blocked";
const TROUBLE_PATIENCE = 6; // s without a connection until the page looks for the reason

const newSlice = () => ({
  /** a problem of the connection, with advice: pages/check/verdict.js; null without one */
  finding: /** @type {{word: string, values: Record<string, string | number>} | null} */ (null),
  /** the browser to use instead of one inside an app: pages/check/in_app.js; empty elsewhere */
  betterBrowser: "",
  /**
   * practising with a simulated robot (practice.js): not offered, offered, starting, in progress
   */
  practice: /** @type {"none" | "off" | "starting" | "on"} */ ("none"),
  /** whether the link to this page was copied */
  copied: false,
  /** whether a waiting visitor can still be asked to allow notifications */
  notifiable: false,
  /** other robots that a waiting visitor could drive at once: free_robots.js */
  freeRobots: /** @type {import("../view/hud/card.js").FreeRobot[]} */ ([]),
});

/** @typedef {ReturnType<typeof newSlice>} Slice */

/** @type {Feature["setUp"]} */
const setUp = (page) => {
  const { store } = page;
  const lazyPanels = lazy(async () => (await import("./lazy_panels.js")).createLazyPanels(page));
  let troubledSince = 0; // 0: all is well

  /** Without a connection, looks for the reason, once. @param {number} now */
  const watchTrouble = (now) => {
    const { visit, playing, slow, finding } = store.get();
    const blind = roleOf(visit) !== "" && (slow || !playing) && !isRobotsFault(store.get());
    if (visit.socket === "open" ? !blind : visit.phase === "closed") {
      troubledSince = 0;
      if (finding && (playing || isRobotsFault(store.get()))) {
        store.update({ finding: null });
      }
    } else if (troubledSince === 0) {
      troubledSince = now;
    } else if (now - troubledSince > TROUBLE_PATIENCE) {
      troubledSince = Infinity; // once for each trouble
      lazyPanels(
        ({ examine }) => void examine(),
        // without any connection to the server: tried again
        () => (troubledSince = now),
      );
    }
  };

  // A browser lets a page play sounds only after a click.
  window.addEventListener("click", () => {
    if (["taking", "queued", "turn"].includes(store.get().visit.phase)) {
      lazyPanels(({ prepare }) => void prepare());
    }
  });

  return {
    api: { lazyPanels },
    actions: {
      tell_me: () => lazyPanels((panels) => void panels.tell_me()),
      copy_link: () => lazyPanels((panels) => void panels.copy_link()),
      souvenir: () => lazyPanels((panels) => void panels.souvenir()),
      go_slow: () => lazyPanels((panels) => panels.go_slow()),
      practise: () => lazyPanels((panels) => panels.practise()),
    },
    on: {
      phase: (phase, before) => {
        if (phase === "queued") {
          lazyPanels(({ waits }) => waits());
        } else if (before === "queued") {
          lazyPanels(({ practice_over }) => practice_over());
          store.update({ freeRobots: [] });
        }
      },
      socketOpen: () => store.get().finding?.word === UNREACHED && store.update({ finding: null }),
      second: (now) => {
        watchTrouble(now);
        if (store.get().visit.phase === "queued") {
          lazyPanels(({ look_for_free_robots }) => look_for_free_robots(now));
        }
      },
    },
  };
};

/** @type {Feature} */
export const waiting = { name: "waiting", state: newSlice, setUp };
