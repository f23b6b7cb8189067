/**
 * A study on the drive page: what it hears, shows, asks the robot for and writes down. console.js calls it; what to do is decided in the
 * pure modules beside it.
 */

import { unixNow } from "../lib/clock.js";
import { lazy } from "../lib/lazy.js";
import { freshId } from "../lib/ids.js";
import { ask, heard, pass } from "../autonomy/robot_action.js";
import { GO_ON_SECONDS, hasEnded } from "./end_cards.js";
import { hear } from "./guide.js";
import { pursue, windowFor } from "./photo.js";
import { createRecorder } from "./recorder.js";

const AGAIN = 2000; // ms until a part of the page that did not arrive is lazy again

/**
 * @param {object} page
 * @param {ReturnType<typeof import("../drive/store.js").createStore>} page.store
 * @param {any} page.config of the page
 * @param {import("../lib/words.js").Words} page.words
 * @param {(id: string) => HTMLElement} page.element
 * @param {import("../view/map/robot_map.js").RobotMap} page.map
 * @param {(type: string, data?: Record<string, string | number | boolean | null>, stamp?: number) => boolean} page.report
 * @param {(order: import("../autonomy/robot_action.js").Task) => void} page.sendAction
 */
export const createStudy = ({ store, config, words, element, map, report, sendAction }) => {
  const records = createRecorder({ get: store.get, report, now: unixNow });
  /** @type {(state: import("../drive/store.js").State) => void} */
  let showStudy = () => undefined;
  if (config.study) {
    const sight = lazy(() => import("./panels.js"));
    const begin = () =>
      sight(
        ({ createStudyPanels }) => {
          showStudy = createStudyPanels({ snapshots: config.snapshots, words, element, map, act: (action) => actions[action]?.() });
          store.update({});
        },
        () => setTimeout(begin, AGAIN), // a study without its task is none
      );
    begin();
  }

  const takePhoto = () => {
    const { snap, visit } = store.get();
    if (visit.phase === "driving" && (snap === null || snap.status === "FAILED")) {
      const order = ask({ type: "photo" }, freshId("photo-"), unixNow());
      store.update({ snap: order });
      sendAction(order);
    }
  };

  /** @param {"keep" | "again" | "skip"} choice */
  const answerWith = (choice) => {
    const photo = windowFor(store.get())?.photo;
    if (photo !== undefined) {
      const at = unixNow();
      say({ id: freshId("answer-"), photo, choice, at, saidAt: at });
    }
  };

  /** @param {import("./photo.js").Answer} answer */
  const say = (answer) => {
    store.update({ answer });
    // The same answer has the same time, however often it is said.
    report("photo_answer", { id: answer.id, choice: answer.choice, photo: answer.photo }, answer.at);
  };

  /** @type {Record<string, () => void>} */
  const actions = {
    photo_take: takePhoto,
    photo_keep: () => answerWith("keep"),
    photo_again: () => answerWith("again"),
    photo_skip: () => answerWith("skip"),
    go_on: () => location.assign(config.study.urls.step),
  };

  return {
    actions,
    steered: records.steered,
    /** @param {string} session that this page drives from now on */
    began: (session) => {
      const { told } = store.get();
      store.update({ told: told?.session === session ? told : null, endedAt: null, snap: null, answer: null });
    },
    /** @param {Omit<import("./guide.js").Told, "endsAt">} message */
    told: (message) => {
      const { visit, snap, answer } = store.get();
      if (visit.session === null || visit.session === message.session) {
        const told = hear(message, unixNow());
        store.update({ told, snap: told.window === "open" ? snap : null, answer: pursue(answer, told, -Infinity).answer });
      }
    },
    /** @param {Parameters<typeof heard>[1]} message */
    action: (message) => {
      const { snap } = store.get();
      if (snap?.id === message.actionId) {
        store.update({ snap: heard(snap, message, unixNow()) });
      }
    },
    /** @param {import("../drive/store.js").State} state */
    show: (state) => {
      records.show(state);
      showStudy(state);
    },
    /** @param {number} now */
    tick: (now) => {
      const { snap, answer, told, endedAt, study } = store.get();
      lookAfterPhoto(snap, now);
      const next = pursue(answer, told, now);
      if (next.say && next.answer) {
        say(next.answer);
      } else if (next.answer !== answer) {
        store.update({ answer: next.answer });
      }
      if (study && hasEnded(store.get()) && endedAt === null) {
        store.update({ endedAt: now });
      } else if (endedAt !== null && now - endedAt > GO_ON_SECONDS) {
        store.update({ endedAt: Infinity }); // once
        actions.go_on();
      }
    },
  };

  /** @param {import("../autonomy/robot_action.js").Task | null} snap @param {number} now */
  function lookAfterPhoto(snap, now) {
    const { task, send } = pass(snap, now);
    if (task !== snap) {
      store.update({ snap: task });
    }
    if (send && task) {
      sendAction(task);
    }
  }
};
