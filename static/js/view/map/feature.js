/**
 * The map on the drive page: the floor plan with the robot on it, its buttons, how large it is, and
 * the dials beside it.
 */

import { loadFloorPlan, RobotMap } from "./robot_map.js";
import { write } from "../../lib/dom.js";
import { createDials, roomAt } from "./dials.js";
import { addGestures } from "./gestures.js";
import { FOLLOWING, ZOOM_STEP } from "./pan_zoom.js";

const TOOLS = 48; // CSS pixels that the buttons at the map's upper edge take

/**
 * CSS pixels of the map that its buttons cover: none if beside it.
 * @param {HTMLCanvasElement} canvas
 */
const toolsOver = (canvas) =>
  canvas.clientWidth < (canvas.parentElement?.clientWidth ?? 0) - TOOLS ? 0 : TOOLS;

/** @type {Feature["setUp"]} */
const setUp = (page) => {
  const { store, element } = page;
  const map = new RobotMap({
    canvas: /** @type {HTMLCanvasElement} */ (element("map")),
    tools: toolsOver,
  });
  const actions = newActions(store, map);
  const buttons = element("map-tools").querySelectorAll("button");
  addGestures(element("map"), {
    keymap: page.keys.keymap,
    actions,
    zoom: (...how) => map.zoom(...how),
    pan: (dx, dy) => {
      map.pan(dx, dy);
      showSettings(store, map);
    },
    mayAim: () => page.autonomy?.mayAim() ?? false,
    forgetAim: () => page.autonomy?.forgetAim(),
  });
  load(page, map);

  const showDials = createDials(element, document.documentElement.lang);
  const state = element("map-state");
  const setPose = (/** @type {any} */ { pose, stamp }) => map.setPose(pose, stamp);
  return {
    api: map,
    handlers: {
      state: setPose,
      pose: setPose,
      path: ({ points }) => map.setPath(points),
      scan: (message) => map.setScan(message, store.get().factsheet?.laser ?? null),
    },
    actions,
    on: {
      began: () => map.setTrail([]), // without the paths of drivers before
      second: () => write(state, mapState(store.get(), page.words)),
    },
    render: (shown) => {
      const { mapFollows, mapTurns, mapSize, mapOpen } = shown;
      showDials(shown);
      const pressed = /** @type {Record<string, boolean>} */ ({
        map_follow: mapFollows,
        map_turn: mapTurns,
        map_swap: mapSize === "swapped",
        map_large: mapSize === "large",
      });
      buttons.forEach((/** @type {HTMLElement} */ button) => {
        const action = button.dataset.action ?? "";
        if (action in pressed) {
          button.setAttribute("aria-pressed", String(pressed[action]));
        }
      });
      element("map-tools").hidden = !mapOpen;
      element("drive-page").dataset.map = mapOpen ? mapSize : "small";
    },
  };
};

/** The robot's pose, for screen readers. @param {State} state @param {Words} words */
export const mapState = ({ robot, plan }, words) => {
  if (!robot || !plan) {
    return "";
  }
  if (!robot.pose.localized) {
    return words.say("map.lost");
  }
  const eighth = (Math.round(robot.pose.theta / (Math.PI / 4)) + 8) % 8;
  return words.say("map.state", {
    room: roomAt(plan, robot.pose) || "–",
    heading: words.say(`map.heading.${eighth}`),
  });
};

/** @param {Page} page @param {RobotMap} map */
const load = ({ config, store, element }, map) => {
  const showNone = () => element("drive-page").setAttribute("data-no-map", "");
  if (!config.floorplan) {
    showNone();
    return;
  }
  loadFloorPlan(config.floorplan).then(({ site, image }) => {
    map.show(site, image);
    store.update({ plan: site.plan ?? null });
  }, showNone);
};

/** @param {Store} store @param {RobotMap} map */
const showSettings = (store, { settings }) =>
  store.update({ mapFollows: settings.follows, mapTurns: settings.turns });

/** @param {Store} store @param {RobotMap} map @returns {Record<string, () => void>} */
const newActions = (store, map) => {
  /** @param {Partial<import("./pan_zoom.js").ViewSettings>} change */
  const set = (change) => {
    map.setSettings(change);
    showSettings(store, map);
  };
  /** @param {"swapped" | "large"} size */
  const toggle = (size) => () =>
    store.update({ mapSize: store.get().mapSize === size ? "small" : size, mapOpen: true });
  return {
    map: () => store.update({ mapOpen: !store.get().mapOpen }),
    map_in: () => map.zoom(ZOOM_STEP),
    map_out: () => map.zoom(1 / ZOOM_STEP),
    map_all: () => set({ zoom: 1, x: null, y: null, follows: false }),
    map_follow: () => {
      const { follows, zoom } = map.settings;
      set({
        follows: !follows,
        ...(follows
          ? { x: map.view?.x ?? null, y: map.view?.y ?? null }
          : { zoom: Math.max(FOLLOWING, zoom) }),
      });
    },
    map_turn: () => set({ turns: !map.settings.turns }),
    map_swap: toggle("swapped"),
    map_large: toggle("large"),
  };
};

/** @type {Feature} */
export const map = { name: "map", setUp };
