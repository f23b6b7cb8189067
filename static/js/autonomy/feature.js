/**
 * What the robot does by itself, on the drive page: tasks, places and points of the map, the level of assistance and what the robot says
 * about it. console.js calls it; what to do is decided in tasks.js and in pure modules of hud/.
 */

import { roleOf } from "../protocol/session.js";
import { Aiming } from "../input/aiming.js";
import { HeldHelp, NO_HELP, helpFrom } from "./assistance.js";
import { createMapBar, showsLaser } from "./map_bar.js";
import { can } from "./offer.js";
import { createOfferPanel } from "./offer_panel.js";
import { unixNow } from "../lib/clock.js";
import { freshId } from "../lib/ids.js";
import { ask, heard, isUnderWay, pass, wishOf } from "./robot_action.js";
import { wrap } from "../view/overlay/transforms.js";
import { maySend } from "../study/restrictions.js";

const ASSIST_PATIENCE = 3; // s until a level of assistance that does not come into force counts as refused
const PUSH_PERIOD = 0.5; // s between two notes that the visitor presses forward

/** Millimetres and milliradians are enough. @param {number} value */
const round = (value) => Math.round(value * 1000) / 1000;

/** A point can be chosen where that means something. @param {import("../drive/store.js").State} state */
const mayAim = (state) => roleOf(state.visit) === "driver" && ((can(state, "goto") && maySend(state, "map")) || state.aim?.kind === "pose");

/**
 * @param {object} page
 * @param {ReturnType<typeof import("../drive/store.js").createStore>} page.store
 * @param {import("../lib/words.js").Words} page.words
 * @param {(id: string) => HTMLElement} page.element
 * @param {import("../input/key_dispatcher.js").KeyDispatcher} page.keys
 * @param {import("../view/map/robot_map.js").RobotMap} page.map
 * @param {(action: string) => void} page.act
 * @param {(task: import("./robot_action.js").Task) => void} page.sendAction
 * @param {(level: string) => void} page.sendAssist
 */
export const createAutonomy = ({ store, words, element, keys, map, act, sendAction, sendAssist }) => {
  const held = new HeldHelp();
  const shows = [createOfferPanel(element, words, act), createMapBar(element, words, act, keys)];
  /** @type {{task: string, aim: any}} the goal of the last task that was asked for: the same object while it is the same goal */
  let lastGoal = { task: "", aim: null };
  const aiming = new Aiming({
    canvas: element("map"),
    toWorld: (px, py) => map.worldAt(px, py),
    onAim: (x, y, theta) => {
      const kind = store.get().aim?.kind ?? "goal";
      store.update({ aim: { kind, x: round(x), y: round(y), theta: theta === null ? null : round(wrap(theta - (map.view?.turn ?? 0))) }, placesOpen: false });
    },
  });

  /** @param {import("./robot_action.js").Task} task */
  const goalOf = ({ id, order }) => {
    if (lastGoal.task !== id) {
      lastGoal = { task: id, aim: { kind: "goal", x: order.x, y: order.y, theta: order.theta ?? null } };
    }
    return lastGoal.aim;
  };

  /** @param {import("../drive/store.js").State} state */
  const showMarks = (state) => {
    const { task, aim, help } = state;
    const goal = isUnderWay(task) && task?.type === "goto" && task.order.x !== undefined ? goalOf(task) : null;
    const chosen = aim !== null && aim.x !== null ? /** @type {any} */ (aim) : null;
    map.setMarks({ aim: chosen ?? goal, minded: help.point, laser: showsLaser(state) });
    // The buttons never lie over the point that they are about.
    element("aim").toggleAttribute("data-high", chosen !== null && map.isLow(chosen));
  };

  /** Ask the robot to do something by itself. @param {Parameters<typeof ask>[0]} wish */
  const order = (wish) => {
    if (roleOf(store.get().visit) === "driver") {
      const task = ask(wish, freshId("act-"), unixNow());
      store.update({ task, aim: null, placesOpen: false });
      sendAction(task);
    }
  };

  /** What is chosen on the map, as fields of an action. */
  const aimed = () => {
    const { x, y, theta } = store.get().aim ?? { x: null, y: null, theta: null };
    return x === null || y === null ? null : { x, y, ...(theta === null ? {} : { theta }) };
  };

  /** @param {ReturnType<typeof helpFrom>} help */
  const showHelp = (help) => {
    if (help !== store.get().help) {
      store.update({ help });
    }
  };

  /** @type {Record<string, () => void>} */
  const actions = {
    places: () => store.update({ placesOpen: !store.get().placesOpen }),
    undock: () => order({ type: "undock" }),
    go_home: () => order({ type: "dock" }),
    go_here: () => {
      const goal = aimed();
      if (goal) {
        order({ type: "goto", ...goal });
      }
    },
    search: () => order({ type: "relocalize" }),
    show_pose: () => store.update({ aim: { kind: "pose", x: null, y: null, theta: null }, placesOpen: false, mapOpen: true }),
    set_pose: () => {
      const pose = aimed();
      if (pose) {
        // Without a drag it looks where it looked.
        order({ type: "relocalize", theta: store.get().robot?.pose.theta ?? 0, ...pose });
      }
    },
    aim_cancel: () => store.update({ aim: null }),
    task_again: () => {
      const { task } = store.get();
      if (task) {
        order(wishOf(task));
      }
    },
    task_dismiss: () => store.update({ task: null }),
    laser: () => store.update({ laser: !showsLaser(store.get()) }),
  };

  return {
    actions,
    /** Nothing of a visit that is over is left. */
    forget: () => store.update({ task: null, aim: null, placesOpen: false, help: NO_HELP, assistAsked: null }),
    mayAim: () => mayAim(store.get()),
    forgetAim: () => {
      aiming.letGo();
      store.update({ aim: null });
    },
    /** @param {string} place */
    goTo: (place) => {
      const { title = place } = store.get().plan?.places?.find((/** @type {any} */ one) => one.name === place) ?? {};
      order({ type: "goto", place, title });
    },
    /** @param {string} level */
    assist: (level) => {
      store.update({ assistAsked: { level, at: unixNow() } });
      sendAssist(level);
    },
    /** @param {Parameters<typeof heard>[1]} message */
    action: (message) => {
      const { task, visit } = store.get();
      if (visit.phase === "driving") {
        store.update({ task: heard(task, message, unixNow()) });
      }
    },
    /** @param {{assist: string}} message a state that is newer than what was known */
    state: ({ assist }) => {
      const asked = store.get().assistAsked;
      if (asked && (asked.level === assist || unixNow() - asked.at > ASSIST_PATIENCE)) {
        store.update({ assistAsked: null });
      }
    },
    /** @param {{assistWhy: string, assistPoint: [number, number] | null}} message */
    help: ({ assistWhy, assistPoint }) => showHelp(held.hear(helpFrom(assistWhy, assistPoint), unixNow())),
    /** Whoever drives has read what failed; and pressing forward at the dock wants a word. @param {{linear: number, angular: number}} intent */
    steered: ({ linear, angular }) => {
      const { task, pushedAt } = store.get();
      if ((linear !== 0 || angular !== 0) && task?.status === "FAILED") {
        store.update({ task: null });
      }
      const now = unixNow();
      if (linear > 0 && now - pushedAt > PUSH_PERIOD) {
        store.update({ pushedAt: now, now });
      }
    },
    /** @param {import("../drive/store.js").State} state */
    show: (state) => {
      shows.forEach((show) => show(state));
      showMarks(state);
      if (mayAim(state)) {
        aiming.enable();
      } else {
        aiming.disable();
      }
    },
    /** @param {number} now */
    tick: (now) => {
      const { task, send } = pass(store.get().task, now);
      if (task !== store.get().task) {
        store.update({ task });
      }
      if (send && task) {
        sendAction(task);
      }
      showHelp(held.tick(now));
    },
  };
};
