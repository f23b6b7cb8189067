/** The robot's actions and assistance on the drive page. The modules beside it decide; pure. */

import { recallAimed, rememberAimed } from "../lib/storage.js";
import { Aiming } from "../input/aiming.js";
import { unixNow } from "../lib/clock.js";
import { freshId } from "../lib/ids.js";
import { roleOf } from "../protocol/session.js";
import { maySend, can } from "../protocol/capabilities.js";
import { wrap } from "../lib/transforms.js";
import { leavesByItself } from "./arrival.js";
import { HeldHelp, NO_HELP, helpFrom } from "./assistance.js";
import { createMapBar, showsLaser } from "./map_bar.js";
import { createOfferPanel } from "./offer_panel.js";
import { ask, heard, isUnderWay, pass, wishOf } from "../protocol/robot_action.js";

// s until a level of assistance that the robot does not confirm counts as refused
const ASSIST_PATIENCE = 3;
const PUSH_PERIOD = 0.5; // s between two records that the visitor presses forward

/** Millimetres and milliradians are enough. @param {number} value */
const round = (value) => Math.round(value * 1000) / 1000;

/** @param {State} state */
const mayAim = (state) =>
  roleOf(state.visit) === "driver" &&
  ((can(state, "goto") && maySend(state, "map")) || state.aim?.kind === "pose");

/** @param {Page} page */
const setUp = (page) => {
  const { store, words, element, keys, act, config } = page;
  store.update({ hasAimed: recallAimed(config.who ?? "") });
  const held = new HeldHelp();
  const renders = [
    createOfferPanel(element, words, act),
    createMapBar(element, words, act, keys),
    createMarks(page),
  ];
  const aiming = newAiming(page);

  /** @param {ReturnType<typeof helpFrom>} help */
  const showHelp = (help) => help !== store.get().help && store.update({ help });
  const hearHelp = (/** @type {any} */ { assistWhy, assistPoint }) =>
    showHelp(held.hear(helpFrom(assistWhy, assistPoint), unixNow()));
  /** @param {string} level */
  const assist = (level) => {
    store.update({ assistAsked: { level, at: unixNow() } });
    page.connection.send("session/assist", { level });
  };

  return {
    api: {
      assist,
      mayAim: () => mayAim(store.get()),
      forgetAim: () => {
        aiming.letGo();
        store.update({ aim: null });
      },
    },
    handlers: {
      state: hearHelp,
      pose: hearHelp,
      action: (/** @type {Parameters<typeof heard>[1]} */ message) => {
        const { task, visit } = store.get();
        if (visit.phase === "driving") {
          store.update({ task: heard(task, message, unixNow()) });
        }
      },
      denied: (/** @type {{suffix: string}} */ { suffix }) =>
        suffix === "session/assist" && store.update({ assistAsked: null }),
    },
    actions: { ...newActions(page), assist },
    on: {
      ...newListeners(page),
      changed: (/** @type {State} */ state) => (mayAim(state) ? aiming.enable() : aiming.disable()),
      poll: (/** @type {number} */ now) => {
        arrive(page, now);
        pursue(page, now);
        showHelp(held.tick(now));
      },
    },
    render: (/** @type {State} */ state) => renders.forEach((render) => render(state)),
  };
};

/** @param {Page} page */
const newAiming = ({ store, element, map }) =>
  new Aiming({
    canvas: element("map"),
    toWorld: (px, py) => map.worldAt(px, py),
    onAim: (x, y, theta) => {
      const kind = store.get().aim?.kind ?? "goal";
      store.update({
        aim: {
          kind,
          x: round(x),
          y: round(y),
          theta: theta === null ? null : round(wrap(theta - (map.view?.turn ?? 0))),
        },
        placesOpen: false,
      });
    },
  });

/**
 * Start a visit with the room in sight. In a hidden tab the robot stays, then and later.
 * @param {Page} page @param {number} now
 */
const arrive = ({ store, act }, now) => {
  const { visit, robot, arrival } = store.get();
  if (roleOf(visit) !== "driver" || !robot || (robot.session ?? null) !== visit.session) {
    return; // this state belongs to the session before
  }
  if (arrival?.session !== visit.session) {
    const stopId = robot.safety.stopId ?? null;
    const isOver = document.hidden;
    store.update({ arrival: { session: visit.session, stopId, isOver, since: now } });
    return;
  }
  const leaves = leavesByItself(store.get(), now);
  if (!arrival.isOver && leaves !== null) {
    store.update({ arrival: { ...arrival, isOver: true } });
    if (leaves && !document.hidden) {
      act("undock");
    }
  }
};

/** @param {Page} page @param {number} now */
const pursue = ({ store, driving }, now) => {
  const { action, send } = pass(store.get().task, now);
  if (action !== store.get().task) {
    store.update({ task: action });
  }
  if (send && action) {
    driving.sendAction(action);
  }
};

/** The marks of goal and obstacle on the map. @param {Page} page */
const createMarks = ({ map }) => {
  /** The goal of the last requested action: the same object while the goal is the same. */
  let last = { id: "", aim: /** @type {any} */ (null) };

  /** @param {RobotAction} action */
  const goalOf = ({ id, fields }) => {
    if (last.id !== id) {
      last = { id, aim: { kind: "goal", x: fields.x, y: fields.y, theta: fields.theta ?? null } };
    }
    return last.aim;
  };

  return (/** @type {State} */ state) => {
    const { task, aim, help } = state;
    const goal =
      isUnderWay(task) && task?.type === "goto" && task.fields.x !== undefined
        ? goalOf(task)
        : null;
    const chosen = aim !== null && aim.x !== null ? aim : null;
    map.setMarks({ aim: chosen ?? goal, obstacle: help.point, laser: showsLaser(state) });
  };
};

/** @param {Page} page @returns {Record<string, (argument: string) => void>} */
const newActions = ({ store, driving, config }) => {
  /** @param {Parameters<typeof ask>[0]} wish */
  const start = (wish) => {
    if (roleOf(store.get().visit) === "driver") {
      const task = ask(wish, freshId("act-"), unixNow());
      store.update({ task, aim: null, placesOpen: false });
      driving.sendAction(task);
    }
  };

  /** With the point chosen on the map, if there is one. @param {Parameters<typeof ask>[0]} wish */
  const startAimed = (wish) => {
    const { x, y, theta } = store.get().aim ?? { x: null, y: null, theta: null };
    if (x !== null && y !== null) {
      rememberAimed(config.who ?? "");
      store.update({ hasAimed: true });
      start({ ...wish, x, y, ...(theta === null ? {} : { theta }) });
    }
  };

  return {
    places: () => store.update({ placesOpen: !store.get().placesOpen }),
    undock: () => start({ type: "undock" }),
    go_home: () => start({ type: "dock" }),
    go_to: (place) => {
      const { title = place } =
        store.get().plan?.places?.find((/** @type {any} */ { name }) => name === place) ?? {};
      start({ type: "goto", place, title });
    },
    /** To the point of the video that has no straight path. */
    go_around: () => {
      const [x, y] = store.get().said?.refused?.goal ?? [null, null];
      if (x !== null && y !== null) {
        store.update({ said: null });
        start({ type: "goto", x: round(x), y: round(y) });
      }
    },
    go_here: () => startAimed({ type: "goto" }),
    search: () => start({ type: "relocalize" }),
    show_pose: () =>
      store.update({
        aim: { kind: "pose", x: null, y: null, theta: null },
        placesOpen: false,
        mapOpen: true,
      }),
    // Without a drag it keeps its heading.
    set_pose: () => startAimed({ type: "relocalize", theta: store.get().robot?.pose.theta ?? 0 }),
    aim_cancel: () => store.update({ aim: null }),
    task_again: () => {
      const { task } = store.get();
      if (task) {
        start(wishOf(task));
      }
    },
    task_dismiss: () => store.update({ task: null }),
    laser: () => store.update({ laser: !showsLaser(store.get()) }),
  };
};

/** @param {Page} page */
const newListeners = ({ store }) => ({
  released: () =>
    store.update({
      task: null,
      aim: null,
      placesOpen: false,
      help: NO_HELP,
      assistAsked: null,
      assistKnown: null,
    }),
  newRobotState: (/** @type {{assist: string, session: string | null}} */ { assist, session }) => {
    const { assistAsked: asked, assistKnown: known, visit } = store.get();
    if (
      session !== null &&
      session === visit.session &&
      (known?.session !== session || known.level !== assist)
    ) {
      store.update({ assistKnown: { session, level: assist } });
    }
    if (asked && (asked.level === assist || unixNow() - asked.at > ASSIST_PATIENCE)) {
      store.update({ assistAsked: null });
    }
  },
  /** Steering hides a failure, unless the page drives to a point; at the dock it shows a hint. */
  steered: (/** @type {{linear: number, angular: number}} */ { linear, angular }) => {
    const { task, pushedAt, said, maneuver } = store.get();
    if ((linear !== 0 || angular !== 0) && said?.word.startsWith("point.") && maneuver === null) {
      store.update({ said: null });
    }
    if ((linear !== 0 || angular !== 0) && task?.status === "FAILED") {
      store.update({ task: null });
    }
    const now = unixNow();
    if (linear > 0 && now - pushedAt > PUSH_PERIOD) {
      store.update({ pushedAt: now, now });
    }
  },
});

/** @type {Feature} */
export const autonomy = { name: "autonomy", setUp };
