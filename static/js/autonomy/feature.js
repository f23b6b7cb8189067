/** The robot's actions and assistance. The pure modules beside it decide. */

import { recallAimed, rememberAimed } from "../lib/storage.js";
import { Aiming } from "../input/aiming.js";
import { unixNow } from "../lib/clock.js";
import { freshId } from "../lib/ids.js";
import { roleOf } from "../protocol/session.js";
import { maySend, can } from "../protocol/capabilities.js";
import { RoutePreview, mayPreview } from "../protocol/route_preview.js";
import { wrap } from "../lib/transforms.js";
import { leavesByItself } from "./arrival.js";
import { HeldHelp, NO_HELP, helpFrom } from "./assistance.js";
import { createMapBar, showsLaser } from "./map_bar.js";
import { createOfferPanel } from "./offer_panel.js";
import { ask, heard, isUnderWay, pursue, wishOf } from "../protocol/robot_action.js";

const ASSIST_PATIENCE = 3; // s until an unconfirmed level of assistance counts as refused
const PUSH_PERIOD = 0.5; // s between two updates that the visitor presses forward

/** Millimetres and milliradians are enough. @param {number} value */
const round = (value) => Math.round(value * 1000) / 1000;

/** @param {State} state */
const mayAim = (state) =>
  roleOf(state.visit) === "driver" &&
  ((can(state, "goto") && maySend(state, "map")) || state.aim?.kind === "pose");

/** @type {Feature["setUp"]} */
const setUp = (page) => {
  const { store, words, element, act, config, driving } = page;
  store.update({ hasAimed: recallAimed(config.who ?? ""), assistUsual: config.assist ?? "" });
  const held = new HeldHelp();
  const preview = new RoutePreview((request) => driving.askRoute(request));
  const renders = [createOfferPanel(element, words, act), createMapBar(page), createMarks(page)];
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

  const start = starterOf(page);
  const goTo = (/** @type {Point} */ [x, y]) => start({ type: "goto", x: round(x), y: round(y) });

  return {
    api: {
      assist,
      mayAim: () => mayAim(store.get()),
      goTo,
      forgetAim: () => {
        aiming.letGo();
        store.update({ aim: null });
      },
    },
    handlers: {
      state: hearHelp,
      pose: hearHelp,
      action: (message) => {
        const { task, visit } = store.get();
        if (visit.phase === "driving") {
          store.update({ task: heard(task, message, unixNow()) });
        }
      },
      route: (message) =>
        preview.heard(message) && store.update({ aimRoute: preview.asked?.found ?? null }),
      denied: ({ suffix }) => suffix === "session/assist" && store.update({ assistAsked: null }),
    },
    actions: { ...newActions(page, goTo), assist },
    on: {
      ...newListeners(page),
      changed: (state) => {
        mayAim(state) ? aiming.enable() : aiming.disable();
        askAimed(preview, store);
      },
      poll: (now) => {
        arrive(page, now);
        preview.tick(now);
        const task = pursue(store.get().task, now, page.driving.sendAction);
        if (task !== store.get().task) {
          store.update({ task });
        }
        showHelp(held.tick(now));
      },
    },
    render: (state) => renders.forEach((render) => render(state)),
  };
};

/** @param {Page} page */
const newAiming = ({ store, element, map }) =>
  new Aiming({
    canvas: element("map"),
    toWorld: (px, py) => map.worldAt(px, py),
    onAim: (x, y, theta) => {
      const kind = store.get().aim?.kind ?? "goal";
      const heading = theta === null ? null : round(wrap(theta - (map.view?.turn ?? 0)));
      const aim = { kind, x: round(x), y: round(y), theta: heading };
      store.update({ aim, placesOpen: false });
    },
  });

/**
 * Leaves the dock at the start of a session. In a hidden tab the robot stays, also later.
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

/**
 * Asks for the route to the chosen point of the map.
 * @param {RoutePreview} preview @param {Store} store
 */
const askAimed = (preview, store) => {
  const state = store.get();
  const { aim, aimRoute } = state;
  const isGoal = aim?.kind === "goal" && mayPreview(state);
  if (isGoal && aim.x !== null && aim.y !== null) {
    preview.ask([aim.x, aim.y], unixNow());
  } else {
    preview.forget();
  }
  const found = preview.wanted ? preview.answerFor(preview.wanted) : null;
  if (found !== aimRoute) {
    store.update({ aimRoute: found });
  }
};

/** The marks of goal and obstacle on the map. @param {Page} page */
const createMarks = ({ map }) => {
  /** the goal of the last action, the same object while it is the same */
  let last = { id: "", aim: /** @type {any} */ (null) };

  /** @param {RobotAction} action */
  const goalOf = ({ id, fields }) => {
    if (last.id !== id) {
      last = { id, aim: { kind: "goal", x: fields.x, y: fields.y, theta: fields.theta ?? null } };
    }
    return last.aim;
  };

  return (/** @type {State} */ state) => {
    const { task, aim, aimRoute, help } = state;
    const hasGoal = isUnderWay(task) && task?.type === "goto" && task.fields.x !== undefined;
    const goal = hasGoal ? goalOf(task) : null;
    const shown = aim === null || aim.x === null ? goal : aim;
    map.setMarks({
      aim: shown,
      route: aimRoute?.points,
      obstacle: help.point,
      laser: showsLaser(state),
    });
  };
};

/** What starts an action of the robot. @param {Page} page */
const starterOf =
  ({ store, driving }) =>
  (/** @type {Parameters<typeof ask>[0]} */ wish) => {
    if (roleOf(store.get().visit) === "driver") {
      const task = ask(wish, freshId("act-"), unixNow());
      store.update({ task, aim: null, placesOpen: false, pointNote: null });
      driving.sendAction(task);
    }
  };

/** @param {Page} page @param {(point: Point) => void} goTo @returns {Actions} */
const newActions = (page, goTo) => {
  const { store, config } = page;
  const start = starterOf(page);

  /** With the chosen point of the map, if any. @param {Parameters<typeof ask>[0]} wish */
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
    /** to the place that is offered beside a pressed point */
    go_around: () => {
      const { pointNote } = store.get();
      if (pointNote?.goal) {
        goTo(pointNote.goal);
      }
    },
    go_here: () => startAimed({ type: "goto" }),
    search: () => start({ type: "relocalize" }),
    show_pose: () => {
      const aim = /** @type {const} */ ({ kind: "pose", x: null, y: null, theta: null });
      store.update({ aim, placesOpen: false, mapOpen: true });
    },
    // without a drag it keeps its heading
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

/** @param {Page} page @returns {Listeners} */
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
  newRobotState: ({ assist, session }) => {
    const { assistAsked: asked, assistKnown: known, visit } = store.get();
    const isOurs = session !== null && session === visit.session;
    if (isOurs && (known?.session !== session || known?.level !== assist)) {
      store.update({ assistKnown: { session, level: assist }, assistUsual: assist });
    }
    if (asked && (asked.level === assist || unixNow() - asked.at > ASSIST_PATIENCE)) {
      store.update({ assistAsked: null });
    }
  },
  /** Steering hides a failure, unless the page drives to a point; at the dock it shows a hint. */
  steered: ({ linear, angular }) => {
    const { task, pushedAt, said, pointNote, maneuver } = store.get();
    const moves = linear !== 0 || angular !== 0;
    if (moves && maneuver === null && (said?.word.startsWith("point.") || pointNote)) {
      store.update({ said: null, pointNote: null });
    }
    if (moves && task?.status === "FAILED") {
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
