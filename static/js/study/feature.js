/**
 * A study on the drive page: what it hears, shows, asks the robot for and writes down. What to do
 * is decided in the pure modules beside it; what only studies show is fetched by their pages alone
 * (panels.js).
 */

import { ask, heard, pass } from "../protocol/robot_action.js";
import { unixNow } from "../lib/clock.js";
import { freshId } from "../lib/ids.js";
import { lazy } from "../lib/lazy.js";
import { GO_ON_SECONDS, hasEnded } from "./end_cards.js";
import { hear } from "./guide.js";
import { pursue, windowFor } from "./photo.js";
import { createRecorder } from "./recorder.js";

const AGAIN = 2000; // ms until a part of the page that did not arrive is fetched again

/** @param {Page} page */
const setUp = (page) => {
  const { store, config, connection } = page;
  const { report } = connection;
  const recorder = createRecorder({ get: store.get, report, now: unixNow, hud: page.hud });
  /** @type {ReturnType<typeof import("./panels.js").createStudyPanels> | null} */
  let panels = null;
  if (config.study) {
    fetchPanels(page, (fetched) => (panels = fetched));
  }

  /** @param {import("./photo.js").Answer} answer */
  const say = (answer) => {
    store.update({ answer });
    // The same answer has the same time, however often it is said.
    connection.report(
      "photo_answer",
      { id: answer.id, choice: answer.choice, photo: answer.photo },
      answer.at,
    );
  };
  const actions = newActions(page, say);

  return {
    handlers: newHandlers(store),
    actions,
    on: {
      changed: (/** @type {State} */ state) => {
        recorder.show(state);
        panels?.changed(state);
      },
      steered: (/** @type {Intent} */ { linear, angular, method }) => {
        if (linear !== 0 || angular !== 0) {
          recorder.steered(method);
        }
      },
      granted: (/** @type {{session: string}} */ { session }) => {
        const { told } = store.get();
        store.update({
          told: told?.session === session ? told : null,
          endedAt: null,
          snap: null,
          answer: null,
        });
      },
      poll: (/** @type {number} */ now) => {
        watchPhoto(page, now);
        watchAnswer(store, say, now);
        watchEnd(store, actions, now);
      },
    },
    render: (/** @type {State} */ state) => panels?.render(state),
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
      () => setTimeout(begin, AGAIN), // a study without its task is none
    );
  begin();
};

/** @param {Page} page @param {(answer: import("./photo.js").Answer) => void} say */
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

/** @param {Store} store */
const newHandlers = (store) => ({
  "session/task": (/** @type {Omit<import("./guide.js").Told, "endsAt">} */ message) => {
    const { visit, snap, answer } = store.get();
    if (visit.session === null || visit.session === message.session) {
      const told = hear(message, unixNow());
      store.update({
        told,
        snap: told.window === "open" ? snap : null,
        answer: pursue(answer, told, -Infinity).answer,
      });
    }
  },
  action: (/** @type {Parameters<typeof heard>[1]} */ message) => {
    const { snap } = store.get();
    if (snap?.id === message.actionId) {
      store.update({ snap: heard(snap, message, unixNow()) });
    }
  },
});

/** @param {Page} page @param {number} now */
const watchPhoto = ({ store, driving }, now) => {
  const { snap } = store.get();
  const { action, send } = pass(snap, now);
  if (action !== snap) {
    store.update({ snap: action });
  }
  if (send && action) {
    driving.sendAction(action);
  }
};

/**
 * @param {Store} store @param {(answer: import("./photo.js").Answer) => void} say
 * @param {number} now
 */
const watchAnswer = (store, say, now) => {
  const { answer, told } = store.get();
  const next = pursue(answer, told, now);
  if (next.say && next.answer) {
    say(next.answer);
  } else if (next.answer !== answer) {
    store.update({ answer: next.answer });
  }
};

/**
 * A study goes on by itself after its drive.
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
