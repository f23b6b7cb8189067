/**
 * The session on the drive page: carries out what protocol/session.js decides, and keeps what is
 * known of the robot and of other visitors.
 */

import { backToDriving } from "../lib/dom.js";
import { unixNow } from "../lib/clock.js";
import { isRefusal, newRelease } from "../protocol/estop_release.js";
import { awaitsAnswer, isSigning, newVisit, reduce } from "../protocol/session.js";
import { watchActivity } from "./activity.js";
import { newOwnTabs } from "./own_tabs.js";
import { forget, remember, rememberLeaving } from "../lib/storage.js";

const ANSWER_PATIENCE = 3; // s until a request that the server has not answered is repeated

const newSlice = () => ({
  /** the page's relation to the robot: protocol/session.js */
  visit: newVisit(),
  /**
   * the other visitors; without a `driver`, `pause` is why the robot is not ready
   * (view/hud/pause.js); a `private` drive is not shown to this page
   */
  room: {
    driver: /** @type {string | null} */ (null),
    driving: false,
    observers: 0,
    waiting: 0,
    pause: "",
    private: false,
  },
  /** the robot's last state, null before the first; robots.api.messages.State */
  robot: /** @type {any} */ (null),
  /** when it was received, Unix time */
  robotAt: 0,
  /** when the robot's emergency stop was released, Unix time */
  releasedAt: -Infinity,
  /** whether the visitor operates the robot, and so may release its emergency stop */
  operates: false,
  /** whether a display was set up for the robot */
  hasScreen: true,
  /** the requested release of its emergency stop */
  release: /** @type {import("../protocol/estop_release.js").Release | null} */ (null),
  /** whether the robot returns to its dock after a session */
  returnsHome: false,
  /** whether the robot is a simulated one, and the visitor has an account */
  practising: false,
  /** whether the visitor tries a simulated robot without an account */
  guest: false,
  /** the robot's factsheet, null while unknown; robots.api.messages.Factsheet */
  factsheet: /** @type {any} */ (null),
  /** when this page began to drive, and where the robot's odometer began then; null before */
  began: /** @type {{at: number, distance: number} | null} */ (null),
  /** the drive of the session that has ended, null without one: waiting/souvenir.js */
  trip: /** @type {import("../waiting/souvenir.js").Trip | null} */ (null),
  /** the operator's last message */
  notice: "",
  /** whether the visitor is asked to confirm that they leave */
  leaving: false,
  /** whether the visitor is asked to confirm that the drive on their other page ends */
  takingOver: false,
  /** where that page is; empty where the browser cannot say: own_tabs.js */
  elsewhere: /** @type {"" | "browser" | "device"} */ (""),
  /** Unix time, for count-downs; changes once a second */
  now: 0,
});

/** @typedef {ReturnType<typeof newSlice>} Slice */

/** @type {Feature["setUp"]} */
const setUp = (page) => {
  const { store, config, element, keys } = page;
  const control = newControl(page);
  const dispatch = newDispatch(page, control);
  const tabs = newOwnTabs(config.robot);
  let askedSince = 0;

  /** Reports activity: a visitor who only looks or writes is present too. */
  const giveSign = () => {
    if (store.get().visit.phase === "driving") {
      page.connection.report("here");
      dispatch({ type: "here" });
    }
  };
  watchActivity({
    target: window,
    clock: unixNow,
    isAsked: () => store.get().visit.askedUntil !== null,
    onSign: giveSign,
  });
  keys.closes(element("card"), () => {
    const { leaving, takingOver } = store.get();
    page.act(leaving || takingOver ? "stay" : "here");
  });

  return {
    api: {
      dispatch,
      /** @type {Page["session"]["begin"]} */
      begin: (loaded) => {
        control.sessionBefore = loaded.session ?? "";
        dispatch({ type: "loaded", ...loaded });
      },
    },
    handlers: newHandlers(page),
    actions: { ...newActions(page), here: giveSign },
    on: {
      focusLost: (why) => {
        if (why === "pagehide") {
          config.practising ? dispatch({ type: "leave" }) : rememberLeaving(config.robot);
        }
      },
      freed: () => dispatch({ type: "freed" }),
      phase: (phase) => {
        store.update({ takingOver: false });
        tabs.mark(phase === "driving");
        if (phase !== "driving") {
          void tabs.find().then((elsewhere) => store.update({ elsewhere }));
        }
      },
      second: (now) => {
        askedSince = awaitsAnswer(store.get().visit) ? askedSince || now : 0;
        if (askedSince && now - askedSince > ANSWER_PATIENCE) {
          askedSince = now;
          dispatch({ type: "no_answer" });
        }
        checkDeadlines(page, now);
      },
    },
  };
};

/** Takes and releases the lease. @param {Page} page */
const newControl = (page) => {
  const { store, element, keys, emit } = page;
  let driven = ""; // the session that this tab drives
  const control = {
    sessionBefore: "", // the session when the page was loaded
    /** @param {any} lease null when it has ended */
    take: (lease) => {
      if (!lease) {
        store.update({
          began: null,
          trip: tripOf(store.get(), driven, page.map?.trail.pieces ?? []),
        });
        emit("released");
        return;
      }
      emit("granted", lease);
      if (lease.session !== driven) {
        driven = lease.session;
        store.update({ trip: null });
        emit("began", lease.session === control.sessionBefore);
      }
      if (!keys.taken) {
        backToDriving(element);
      }
    },
  };
  return control;
};

/**
 * The drive so far. A session that lost its connection in between continues.
 * @param {State} state @param {string} session @param {Point[][]} trail
 */
const tripOf = ({ began, robot, trip }, session, trail) => {
  if (!began || !robot) {
    return trip;
  }
  const { metres, minutes } = trip ?? { metres: 0, minutes: 0 };
  return {
    session,
    metres: metres + Math.max(0, robot.distance - began.distance),
    minutes: minutes + (unixNow() - began.at) / 60,
    trail: trail.map((piece) => [...piece]),
  };
};

/** @param {Page} page @param {ReturnType<typeof newControl>} control */
const newDispatch = (page, control) => {
  const { store, words, emit } = page;
  const title = document.title;
  const effects = {
    ...newEffects(page),
    control: (/** @type {any} */ { lease }) => control.take(lease),
  };

  return (/** @type {import("../protocol/session.js").Happening} */ happening) => {
    const before = store.get().visit;
    const now = unixNow();
    const { visit, effects: wanted } = reduce(before, { ...happening, now });
    store.update({ visit, now });
    document.title = titleOf(visit, words, title);
    if (visit.phase !== before.phase) {
      emit("phase", visit.phase, before.phase);
      performance.mark(`drive:${visit.phase}`);
    }
    for (const effect of wanted) {
      /** @type {any} */ (effects)[effect.type](effect);
    }
  };
};

/**
 * The title of the tab, which also calls the visitor. It is not rendered with the rest, as a hidden
 * page draws nothing.
 * @param {Visit} visit @param {Words} words @param {string} title
 */
const titleOf = ({ phase, askedUntil }, words, title) => {
  const word = askedUntil !== null ? "idle.title" : phase === "turn" ? "turn.title" : "";
  return word ? `${words.say(word)} · ${title}` : title;
};

/** @param {Page} page @param {number} now */
const checkDeadlines = ({ store, session, connection }, now) => {
  const { visit } = store.get();
  if (visit.phase === "turn" && visit.startBy !== null && now > visit.startBy) {
    session.dispatch({ type: "turn_missed" });
  }
  if (isSigning(visit, now)) {
    // until the server confirms it: its own connections may be broken for a moment
    connection.report("here");
  }
};

/**
 * The effects of protocol/session.js, by type.
 * @param {Page} page @returns {Record<string, (effect: any) => void>}
 */
const newEffects = (page) => ({
  send: ({ suffix, message }) => page.connection.send(suffix, message),
  prepare_link: ({ role }) => page.connection.link.prepare(role),
  open_link: ({ role, iceServers, attempt }) =>
    page.connection.link.open(role, iceServers, attempt),
  close_link: () => {
    page.connection.link.close();
    page.emit("linkClosed");
  },
  remember: ({ session }) => remember(page.config.robot, session),
  forget: () => forget(page.config.robot),
  call: ({ word }) => page.waiting.lazyPanels(({ call }) => call(word)),
  close_socket: () => page.connection.socket.close(),
});

/**
 * The odometer of a restarted agent starts at zero; the distance from before still counts.
 * @param {{at: number, distance: number} | null} began
 * @param {any} known the robot's state before
 * @param {{boot: string, distance: number}} state
 */
export const odometerAt = (began, known, { boot, distance }) =>
  began && known && known.boot !== boot
    ? { ...began, distance: began.distance + distance - known.distance }
    : began;

/** @param {Page} page @returns {Handlers} */
const newHandlers = ({ store, emit, words }) => ({
  state: (message) => {
    const { robot: known, visit, began } = store.get();
    if (!known || known.boot !== message.boot || known.seq < message.seq) {
      const isReleased = known?.safety.estop && !message.safety.estop;
      const isFree = !message.safety.estop && message.safety.inhibited !== "stopped";
      store.update({
        robot: message,
        robotAt: unixNow(),
        began: odometerAt(began, known, message),
        ...(isReleased ? { releasedAt: unixNow() } : {}),
        ...(isReleased || isFree ? { release: null } : {}),
      });
      emit("newRobotState", message);
    }
    if (began === null && visit.phase === "driving" && message.session === visit.session) {
      store.update({ began: { at: unixNow(), distance: message.distance } });
    }
  },
  action: (message) => {
    const { release } = store.get();
    if (release && isRefusal(release, message)) {
      store.update({ release: { ...release, refused: true } });
    }
  },
  denied: ({ suffix }) => {
    if (suffix === "command/action") {
      store.update({ release: null }); // the robot did not get it: it is offered again
    }
  },
  factsheet: (factsheet) => {
    store.update({ factsheet });
    emit("factsheet", factsheet);
  },
  room: (room) => {
    const isFreed = store.get().room.driver !== null && room.driver === null;
    store.update({
      room: { ...room, driver: words.nameOf(room.driver) },
      ...(room.private && { robot: null }), // the last state would be out of date
    });
    if (isFreed) {
      emit("freed");
    }
  },
  "session/operator_message": ({ text }) => store.update({ notice: text }),
});

/** @param {Page} page @returns {Actions} */
const newActions = (page) => ({
  home: () =>
    page.config.practising && parent !== window
      ? parent.postMessage("practice_over", location.origin)
      : page.element("home").click(),
  practise_again: () =>
    parent === window
      ? location.assign(page.config.again)
      : parent.postMessage("practise_again", location.origin),
  sign_up: () => location.assign(page.config.signUp),
  sign_in: () => location.reload(), // the page's address asks for it, and returns here
  reload: () => location.reload(),
  stay: () => {
    page.store.update({ leaving: false, takingOver: false });
    backToDriving(page.element);
  },
  leave: () =>
    page.store.get().visit.phase === "driving"
      ? page.store.update({ leaving: true })
      : page.act("leave_now"),
  ask_to_take_over: () => page.store.update({ takingOver: true }),
  take_over: () => {
    page.store.update({ takingOver: false });
    page.session.dispatch({ type: "take_over" });
  },
  release_stop: () => {
    const release = newRelease("release-");
    const { id: actionId, since: stamp } = release;
    page.store.update({ release, now: stamp });
    page.connection.send("command/action", { type: "clear_estop", actionId, stamp });
    backToDriving(page.element);
  },
  leave_now: () => {
    page.store.update({ leaving: false, notice: "" });
    page.session.dispatch({ type: "leave" });
  },
});

/** @type {Feature} */
export const session = { name: "session", state: newSlice, setUp };
