/** Sends the page's events for the record of a drive (page_events.js), also without a study. */

import { nameOf } from "../view/display/profiles.js";
import { guideFor } from "./guide.js";
import { Changes, Shown, layoutOf } from "./page_events.js";
import { windowFor } from "./photo.js";

const AGAIN_SECONDS = 2; // until a first frame that the server has not confirmed is repeated
const STEADY_MS = 400; // without another change of the window's size
const PERMISSIONS = ["camera", "microphone"];

/**
 * @param {object} options @param {() => State} options.get
 * @param {Page["connection"]["report"]} options.report
 * @param {() => number} options.now Unix seconds @param {Page["hud"]} options.hud
 */
export const createRecorder = ({ get, report, now, hud }) => {
  const [cue, alert] = [new Shown("cue_shown"), new Shown("alert_shown")];
  const [card, photo] = [new Shown("card_shown"), new Shown("photo_window_shown")];
  const [layout, map] = [new Changes("layout"), new Changes("map")];
  const controller = new Changes("controller");
  const firstFrame = newFirstFrame(report, now);
  let session = /** @type {string | null} */ (null);
  let profile = "";

  /** @param {import("./page_events.js").Note | null} note */
  const write = (note) => note && report(note.type, note.data);
  const isDriving = () => get().visit.phase === "driving";
  /** The start of a session records everything once. */
  const hasBegun = () => isDriving() && get().visit.session === session;
  const sayLayout = () => hasBegun() && write(layout.hear(layoutNow(get())));

  const sayPermissions = () => hasBegun() && permissions.notes().forEach(write);
  onResized(sayLayout);
  document.addEventListener(
    "visibilitychange",
    () => isDriving() && report("tab", { hidden: document.hidden }),
  );
  addEventListener("pagehide", () => write(cue.hear("", null, now())));
  const permissions = watchPermissions(sayPermissions);

  /** A session has started. @param {string} id */
  const begin = (id) => {
    session = id;
    firstFrame.reset();
    [alert, card, photo].forEach((shown) => shown.hear("", null, now()));
    [layout, map, controller, permissions].forEach((changes) => changes.reset());
    sayLayout();
    sayPermissions();
  };

  /** @param {State} state */
  const show = (state) => {
    const at = now();
    if (isDriving() && state.visit.session !== session) {
      begin(/** @type {string} */ (state.visit.session));
    }
    const guide = guideFor(state);
    write(cue.hear(guide?.cue ?? "", guide?.number ?? null, at));
    if (!isDriving()) {
      return; // visitors who wait or watch have no record
    }
    write(alert.hear(hud.alertFor(state)?.word ?? "", null, at));
    write(card.hear(hud.cardFor(state)?.word ?? "", null, at));
    write(photo.hear(windowFor(state)?.word ?? "", null, at));
    write(map.hear({ open: state.mapOpen }));
    if (nameOf(state) !== profile) {
      profile = nameOf(state);
      sayLayout();
    }
    firstFrame.say(state);
  };

  return {
    show,
    steered: (/** @type {string} */ method) => hasBegun() && write(controller.hear({ method })),
  };
};

/**
 * The first frame starts the time of the task, and is repeated until the server has it.
 * @param {Page["connection"]["report"]} report @param {() => number} now Unix seconds
 */
const newFirstFrame = (report, now) => {
  let framed = -Infinity;
  return {
    reset: () => (framed = -Infinity),
    /** @param {State} state */
    say: ({ progress, playing, slow }) => {
      const isUnknown = framed === -Infinity || progress?.cue === "wait_for_picture";
      const isDue = playing && isUnknown && now() - framed > AGAIN_SECONDS;
      if (isDue && report("first_frame", { way: slow ? "server" : "direct" })) {
        framed = now();
      }
    },
  };
};

/** Calls when the window has a new size. @param {() => void} tell */
const onResized = (tell) => {
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let timer;
  addEventListener("resize", () => {
    clearTimeout(timer);
    timer = setTimeout(tell, STEADY_MS);
  });
};

/** @param {State} state */
const layoutNow = (state) => ({
  interface: nameOf(state),
  layout: layoutOf(innerWidth, innerHeight),
  width: innerWidth,
  height: innerHeight,
  screen_width: screen.width,
  screen_height: screen.height,
  density: devicePixelRatio,
  touch: matchMedia("(any-pointer: coarse)").matches,
});

/** The browser's permissions. @param {() => unknown} changed */
const watchPermissions = (changed) => {
  const reports = new Map(PERMISSIONS.map((name) => [name, new Changes("permission")]));
  const granted = new Map(/** @type {[string, string][]} */ ([]));
  for (const name of PERMISSIONS) {
    void watchPermission(name, (state) => {
      granted.set(name, state);
      changed();
    });
  }
  return {
    reset: () => reports.forEach((changes) => changes.reset()),
    /** those that are not recorded yet */
    notes: () =>
      Array.from(granted, ([name, state]) => reports.get(name)?.hear({ name, state }) ?? null),
  };
};

/**
 * One permission, now and whenever it changes.
 * @param {string} name @param {(state: string) => unknown} tell
 */
const watchPermission = async (name, tell) => {
  try {
    const status = await navigator.permissions.query({
      name: /** @type {PermissionName} */ (name),
    });
    status.onchange = () => tell(status.state);
    tell(status.state);
  } catch (error) {
    // The browser does not know the permission.
    if (!(error instanceof TypeError)) {
      throw error;
    }
  }
};
