/** Driving by hand: the controllers, their velocities, and stops. */

import { unixNow } from "../lib/clock.js";
import { lazy } from "../lib/lazy.js";
import { TICK_SECONDS } from "../protocol/command_stream.js";
import { roleOf } from "../protocol/session.js";
import { mayWriteWaiting, controllersOf } from "../protocol/capabilities.js";
import { messageOf } from "../protocol/robot_action.js";
import { onFocusLoss } from "./focus_loss.js";
import { Steering } from "./steering.js";

const STOP_PATIENCE = 3; // s that a stop is repeated after the session

const newSlice = () => ({
  /** index into input/speeds.js STEPS */
  speedStep: 1,
  /** a controller that was tried although the study excludes it, and when; null for none */
  barred: /** @type {{method: string, at: number} | null} */ (null),
  /** whether a stop was sent and not yet echoed */
  stopping: false,
  /** whether the echo of a stop that was pressed is overdue */
  stopUnconfirmed: false,
});

/** @typedef {ReturnType<typeof newSlice>} Slice */

/** @type {Feature["setUp"]} */
const setUp = (page) => {
  const { store, element, emit } = page;
  const { commands, router } = page.connection;
  const sendVelocity = () => router.sendVelocity(unixNow(), page.video.frameStamp());

  /** Releases all controllers and stops the robot. */
  const halt = (/** @type {boolean} */ isAsked) => {
    steering.letGo();
    if (roleOf(store.get().visit)) {
      router.stop(unixNow(), "stop", isAsked);
      store.update({ stopping: true });
    }
  };
  const brake = () => halt(true); // the visitor pressed it

  const steering = new Steering({
    keys: page.keys,
    pad: element("stick"),
    knob: element("stick-knob"),
    onIntent: (intent) => {
      if (commands.intend(intent)) {
        sendVelocity();
      }
      emit("steered", intent);
    },
    onBarred: (method) => store.update({ barred: { method, at: unixNow() }, now: unixNow() }),
    onStop: brake,
    onStep: (speedStep) => store.update({ speedStep }),
  });
  steering.robotLimits = page.config.factsheet?.limits ?? null;

  setUpOwnKeys(page);
  onFocusLoss((why) => {
    if (steering.enabled) {
      halt(false);
      page.connection.report(why);
    }
    emit("focusLost", why);
  });

  return {
    api: {
      steering,
      brake,
      sendVelocity,
      /** Without video the robot stops, and the page says so. */
      standStill: () => {
        store.update({ playing: false });
        halt(false);
      },
      ...senders(page),
    },
    handlers: {
      state: (message) => commands.heardState(message),
      action: (message) => commands.heardAction(message),
    },
    actions: { stop: brake, speed: (step) => steering.setStep(Number(step)) },
    on: newListeners(page, steering),
  };
};

/** The list of keys, fetched when it is first opened. @param {Page} page */
const setUpOwnKeys = (page) => {
  const button = page.element("own-keys-open");
  const fetchList = lazy(async () => (await import("./own_keys.js")).createOwnKeys(page));
  button.addEventListener("click", () =>
    fetchList(({ show }) => {
      const opens = button.getAttribute("aria-expanded") === "false";
      button.setAttribute("aria-expanded", String(opens));
      show(opens);
    }),
  );
};

/** @param {Page} page */
const senders = ({ store, connection: { commands, router, send } }) => ({
  /** @param {RobotAction} action */
  sendAction: (action) => {
    if (!commands.binding && action.type === "say" && mayWriteWaiting(store.get())) {
      send("command/action", messageOf(action, {}, unixNow()));
    } else if (commands.binding) {
      const now = unixNow();
      const isRepeated = now - action.askedAt > TICK_SECONDS;
      router.sendAction(messageOf(action, commands.binding, now), isRepeated);
    }
  },
  /** @param {{stamp: number, at: Point | null}} pointer */
  sendPointer: (pointer) =>
    commands.binding && router.sendPointer(pointer.stamp, { ...commands.binding, ...pointer }),
  /** @param {{requestId: string, x: number, y: number}} request */
  askRoute: (request) =>
    commands.binding && router.askRoute(unixNow(), { ...commands.binding, ...request }),
});

/** @param {Page} page @param {Steering} steering @returns {Listeners} */
const newListeners = ({ store, connection: { commands, router } }, steering) => ({
  granted: (lease) => {
    commands.bind(lease);
    steering.leaseLimits = lease.limits;
    steering.allow(controllersOf(store.get()));
    router.only = store.get().visit.terms?.controlWay ?? "any";
    steering.enable();
  },
  released: () => {
    steering.disable();
    commands.unbind();
  },
  factsheet: ({ limits }) => (steering.robotLimits = limits),
  poll: (now) => {
    const since = commands.pending?.since ?? now;
    if (!roleOf(store.get().visit) && now - since > STOP_PATIENCE) {
      commands.giveUp();
    }
    store.update({
      stopping: commands.pending !== null,
      stopUnconfirmed: commands.isUnconfirmed(now),
    });
  },
});

/** @type {Feature} */
export const driving = { name: "driving", state: newSlice, setUp };
