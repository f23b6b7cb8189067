/**
 * A study on the drive page: its task, its photo and the record of the drive. The pure modules
 * beside it decide; pages of studies fetch what only they show (panels.js).
 */

import { ask, heard, pursue } from "../protocol/robot_action.js";
import { unixNow } from "../lib/clock.js";
import { freshId } from "../lib/ids.js";
import { lazy } from "../lib/lazy.js";
import { GO_ON_SECONDS, hasEnded } from "./end_cards.js";
import { hear } from "./guide.js";
import { answerAfter, windowFor } from "./photo.js";
import { createRecorder } from "./recorder.js";

const AGAIN = 2000; // ms until a part of the page that did not arrive is fetched again

/** @typedef {import("./photo.js").Answer} Answer */

/** @type {Feature["setUp"]} */
const setUp = (page) => {
  const { store, config, connection } = page;
  const { report } = connection;
  const recorder = createRecorder({ get: store.get, report, now: unixNow, hud: page.hud });
  /** @type {ReturnType<typeof import("./panels.js").createStudyPanels> | null} */
  let panels = null;
  if (config.study) {
    fetchPanels(page, (fetched) => (panels = fetched));
  }

  /** Repetitions of an answer have its time. @param {Answer} answer */
  const say = (answer) => {
    store.update({ answer });
    const { id, choice, photo, at } = answer;
    connection.report("photo_answer", { id, choice, photo }, at);
  };
  const actions = newActions(page, say);

  return {
    handlers: newHandlers(store),
    actions,
    on: {
      changed: (state) => {
        recorder.show(state);
        panels?.changed(state);
      },
      steered: ({ linear, angular, method }) => {
        if (linear !== 0 || angular !== 0) {
          recorder.steered(method);
        }
      },
      granted: ({ session }) => {
        const { progress } = store.get();
        const known = progress?.session === session ? progress : null;
        store.update({ progress: known, endedAt: null, snap: null, answer: null });
      },
      poll: (now) => {
        const snap = pursue(store.get().snap, now, page.driving.sendAction);
        if (snap !== store.get().snap) {
          store.update({ snap });
        }
        watchAnswer(store, say, now);
        watchEnd(store, actions, now);
      },
    },
    render: (state) => panels?.render(state),
  };
};

/**
 * @param {Page} page
 * @param {(panels: ReturnType<typeof import("./panels.js").createStudyPanels>) => void} use
 */
const fetchPanels = ({ store, config, words, element, map, act }, use) => {
  const panels = lazy(() => import("./panels.js"));
  const begin = () =>
    panels(
      ({ createStudyPanels }) => {
        use(createStudyPanels({ snapshots: config.snapshots, words, element, map, act }));
        store.update({});
      },
      () => setTimeout(begin, AGAIN),
    );
  begin();
};

/** @param {Page} page @param {(answer: Answer) => void} say */
const newActions = ({ store, config, driving }, say) => {
  /** @param {"keep" | "again" | "skip"} choice */
  const answerWith = (choice) => () => {
    const photo = windowFor(store.get())?.photo;
    if (photo !== undefined) {
      const at = unixNow();
      say({ id: freshId("answer-"), photo, choice, at, saidAt: at });
    }
  };
  return {
    photo_take: () => {
      const { snap, visit } = store.get();
      if (visit.phase === "driving" && (snap === null || snap.status === "FAILED")) {
        const action = ask({ type: "photo" }, freshId("photo-"), unixNow());
        store.update({ snap: action });
        driving.sendAction(action);
      }
    },
    photo_keep: answerWith("keep"),
    photo_again: answerWith("again"),
    photo_skip: answerWith("skip"),
    go_on: () => location.assign(config.study.urls.step),
  };
};

/** @param {Store} store @returns {Handlers} */
const newHandlers = (store) => ({
  "session/task": (message) => {
    const { visit, snap, answer } = store.get();
    if (visit.session === null || visit.session === message.session) {
      const progress = hear(message, unixNow());
      store.update({
        progress,
        snap: progress.window === "open" ? snap : null,
        answer: answerAfter(answer, progress, -Infinity).answer,
      });
    }
  },
  action: (message) => {
    const { snap } = store.get();
    if (snap?.id === message.actionId) {
      store.update({ snap: heard(snap, message, unixNow()) });
    }
  },
});

/** @param {Store} store @param {(answer: Answer) => void} say @param {number} now */
const watchAnswer = (store, say, now) => {
  const { answer, progress } = store.get();
  const next = answerAfter(answer, progress, now);
  if (next.say && next.answer) {
    say(next.answer);
  } else if (next.answer !== answer) {
    store.update({ answer: next.answer });
  }
};

/**
 * A study continues by itself after its drive.
 * @param {Store} store @param {{go_on: () => void}} actions @param {number} now
 */
const watchEnd = (store, actions, now) => {
  const { endedAt, study } = store.get();
  if (study && hasEnded(store.get()) && endedAt === null) {
    store.update({ endedAt: now });
  } else if (endedAt !== null && now - endedAt > GO_ON_SECONDS) {
    store.update({ endedAt: Infinity }); // once
    actions.go_on();
  }
};

/** @type {Feature} */
export const study = { name: "study", setUp };
