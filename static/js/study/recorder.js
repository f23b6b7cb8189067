/**
 * Watches the page for what belongs into the record of a drive (page_events.js), and sends it.
 * Works with and without a study.
 */

import { nameOf } from "../view/display/profiles.js";
import { guideFor } from "./guide.js";
import { Changes, Shown, layoutOf } from "./page_events.js";
import { windowFor } from "./photo.js";

const AGAIN_SECONDS = 2; // a first picture that the server has not taken up is told again
const STEADY_MS = 400; // a window that is being pulled larger has many sizes
const PERMISSIONS = ["camera", "microphone"];

/**
 * @param {object} options @param {() => State} options.get
 * @param {(type: string, data?: Record<string, string | number | boolean | null>) => boolean}
 *   options.report whether it was handed to the network
 * @param {() => number} options.now Unix seconds
 * @param {Page["hud"]} options.hud
 */
export const createRecorder = ({ get, report, now, hud }) => {
  const [cue, alert, card] = [
    new Shown("cue_shown"),
    new Shown("alert_shown"),
    new Shown("card_shown"),
  ];
  const photo = new Shown("photo_window_shown");
  const [layout, map, controller] = [
    new Changes("layout"),
    new Changes("map"),
    new Changes("controller"),
  ];
  const firstFrame = newFirstFrame(report, now);
  let session = /** @type {string | null} */ (null);
  let profile = "";

  /** @param {import("./page_events.js").Note | null} note */
  const write = (note) => note && report(note.type, note.data);
  const isDriving = () => get().visit.phase === "driving";
  /** Before a visit has begun here, nothing is written: what began it would write it again. */
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

  /** A visit has begun: what has been so for long is said once. @param {string} id */
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
      return; // who waits or watches has no record
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
 * The task's time begins with the first frame: it is told until it is known.
 * @param {Parameters<typeof createRecorder>[0]["report"]} report
 * @param {() => number} now Unix seconds
 */
const newFirstFrame = (report, now) => {
  let framed = -Infinity;
  return {
    reset: () => {
      framed = -Infinity;
    },
    /** @param {State} state */
    say: ({ told, playing, slow }) => {
      const unknown = framed === -Infinity || told?.cue === "wait_for_picture";
      if (
        playing &&
        unknown &&
        now() - framed > AGAIN_SECONDS &&
        report("first_frame", { way: slow ? "server" : "direct" })
      ) {
        framed = now();
      }
    },
  };
};

/** Once the window has its size. @param {() => void} tell */
const onResized = (tell) => {
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let timer;
  addEventListener("resize", () => {
    clearTimeout(timer);
    timer = setTimeout(tell, STEADY_MS);
  });
};

/** How the page is laid out now. @param {State} state */
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

/** What the browser has been allowed. @param {() => unknown} changed */
const watchPermissions = (changed) => {
  const told = new Map(PERMISSIONS.map((name) => [name, new Changes("permission")]));
  const granted = new Map(/** @type {[string, string][]} */ ([]));
  for (const name of PERMISSIONS) {
    void watchPermission(name, (state) => {
      granted.set(name, state);
      changed();
    });
  }
  return {
    reset: () => told.forEach((changes) => changes.reset()),
    /** What has not been told yet. */
    notes: () =>
      Array.from(granted, ([name, state]) => told.get(name)?.hear({ name, state }) ?? null),
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
    // A browser that does not know the name, or the question at all.
    if (!(error instanceof TypeError)) {
      throw error;
    }
  }
};
