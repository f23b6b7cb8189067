/**
 * Waiting for the robot, and what helps when its connection does not come about. All of it is
 * fetched when it is first needed (lazy_panels.js).
 */

import { lazy } from "../lib/lazy.js";
import { roleOf } from "../protocol/session.js";
import { isRobotsFault } from "./fault.js";

const UNREACHED = "check.server.blocked";
const TROUBLE_PATIENCE = 6; // s without a connection to server or robot until the page looks why

const newSlice = () => ({
  /**
   * what seems wrong with the connection, and what to do: pages/check/verdict.js; null while
   * nothing is known
   */
  finding: /** @type {{word: string, values: Record<string, string | number>} | null} */ (null),
  /**
   * the browser to open this page in where one inside an app has no live video:
   * pages/check/in_app.js; empty elsewhere
   */
  betterBrowser: "",
  /**
   * practising with a simulated robot while one waits: not offered, offered, being made ready,
   * under way: practice.js
   */
  practice: /** @type {"none" | "off" | "starting" | "on"} */ ("none"),
  /** whether the link to this page was copied */
  copied: false,
  /** whether the visitor who waits can still be asked to allow notifications */
  notifiable: false,
  /** the other robots that the visitor who waits could drive at once: free_robots.js */
  freeRobots: /** @type {import("../view/hud/card.js").FreeRobot[]} */ ([]),
});

/** @typedef {ReturnType<typeof newSlice>} Slice */

/** @param {Page} page */
const setUp = (page) => {
  const { store } = page;
  const lazyPanels = lazy(async () => (await import("./lazy_panels.js")).createLazyPanels(page));
  let troubledSince = 0; // 0: all is well

  /**
   * When a connection does not come about, find out once what to tell the visitor.
   * @param {number} now
   */
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
        // no connection to the server at all: tried again while the trouble lasts
        () => (troubledSince = now),
      );
    }
  };

  // Have what calls ready while the visitor waits: a page may sound only after a touch.
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
      phase: (/** @type {string} */ phase, /** @type {string} */ before) => {
        if (phase === "queued") {
          lazyPanels(({ waits }) => waits());
        } else if (before === "queued") {
          lazyPanels(({ practice_over }) => practice_over());
          store.update({ freeRobots: [] });
        }
      },
      // What kept the page from the server is over.
      socketOpen: () => store.get().finding?.word === UNREACHED && store.update({ finding: null }),
      second: (/** @type {number} */ now) => {
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
