/** On the map: the menu of places and actions, and the two buttons for a chosen point. */

import { isOffered, maySend } from "../protocol/capabilities.js";
import { backToDriving, make, write } from "../lib/dom.js";
import { placeBeside } from "../lib/beside.js";
import { assistIn } from "./assistance.js";
import { reasonFor } from "./reasons.js";
import { profileOf } from "../view/display/profiles.js";

/**
 * The entries of the menu. Pure.
 * @param {State} state
 * @returns {{action: string, title?: string, word?: string, pressed?: boolean, aside?: boolean}[]}
 *   a place has a title, other entries a word; those that are no destination are aside
 */
export const menuFor = (state) => {
  const offers = (/** @type {string} */ capability) => isOffered(state, capability);
  const places = offers("goto") && maySend(state, "places") ? (state.plan?.places ?? []) : [];
  if (state.study && !places.length && !offers("dock")) {
    return []; // a participant who drives needs no menu; a lost robot asks by itself
  }
  const toPlace = (/** @type {any} */ { name, title }) => ({
    action: `go_to:${name}`,
    title: title || name,
  });
  const laser = { action: "laser", word: "do.laser", pressed: showsLaser(state), aside: true };
  return [
    ...(offers("dock") && !state.robot?.docked ? [GO_HOME] : []),
    ...places.map(toPlace),
    ...(offers("relocalize") ? [SHOW_POSE] : []),
    ...(offers("scan") ? [laser] : []),
  ];
};

const GO_HOME = { action: "go_home", word: "do.go_home" };
const SHOW_POSE = { action: "show_pose", word: "do.show_pose_menu", aside: true };

/**
 * Whether laser points are drawn: as the visitor chose, else by the profile, else while the robot
 * assists.
 * @param {State} state
 */
export const showsLaser = (state) =>
  state.laser ?? profileOf(state).laser ?? !["", "off"].includes(assistIn(state));

const AT_STATION = 0.4; // m from the robot's station: a press there means to dock
const AT = 0.3; // m from the chosen point: the route leads there

/**
 * The robot's own station.
 * @param {Pick<State, "plan" | "factsheet">} state @returns {{x: number, y: number} | null}
 */
export const stationOf = ({ plan, factsheet }) =>
  plan?.docks?.find((/** @type {any} */ { type }) => type === factsheet?.series?.toLowerCase()) ??
  null;

/** Whether the chosen point is the robot's station, into which it can go. @param {State} state */
export const aimsAtStation = (state) => {
  const { aim } = state;
  const station = aim?.kind === "goal" && isOffered(state, "dock") ? stationOf(state) : null;
  return (
    station !== null &&
    Math.hypot(station.x - Number(aim?.x), station.y - Number(aim?.y)) < AT_STATION
  );
};

/**
 * The sentence about a point of the map, or null. It explains the heading only until the visitor
 * has set one, as it covers part of the map. Pure.
 * @param {State} state @returns {{word: string, values?: Record<string, string>} | null}
 */
export const hintFor = (state) => {
  const { aim, hasAimed, aimRoute } = state;
  if (aim === null || aim.x === null) {
    return aim?.kind === "pose" ? { word: "aim.pose_first" } : null;
  }
  const end = aimRoute?.points.at(-1);
  if (aim.kind === "goal" && aimRoute && !aimsAtStation(state)) {
    if (!end) {
      return reasonFor(aimRoute.reason) ?? { word: "reason.no_way" };
    }
    if (Math.hypot(end[0] - aim.x, end[1] - Number(aim.y)) > AT) {
      return { word: "point.beside" };
    }
  }
  return hasAimed ? null : { word: `aim.${aim.kind}` };
};

/**
 * @param {Page} page @returns {(state: State) => void}
 */
export const createMapBar = ({ element, words, act, keys, map }) => {
  const [toggle, menu, bar] = [element("places-toggle"), element("places"), element("aim")];
  let drawn = "";
  const close = () => {
    act("places");
    backToDriving(element);
  };
  keys.closes(menu, close, () => act("places"));
  toggle.addEventListener("click", (event) => {
    act("places");
    if (!menu.hidden) {
      menu.focus({ preventScroll: true });
    } else if (event.detail > 0) {
      toggle.blur();
    }
  });
  for (const part of [menu, bar]) {
    part.addEventListener("click", ({ target }) => {
      const button = target instanceof Element ? target.closest("button") : null;
      if (button) {
        act(button.dataset.action ?? "");
        backToDriving(element);
      }
    });
  }

  /** @param {ReturnType<typeof menuFor>} entries */
  const fill = (entries) => {
    const key = JSON.stringify(entries);
    if (key !== drawn) {
      drawn = key;
      const button = (/** @type {typeof entries[0]} */ entry) => menuButton(entry, words);
      const goals = entries.filter(({ aside }) => !aside).map(button);
      const others = entries.filter(({ aside }) => aside).map(button);
      const divider = goals.length && others.length ? [make("hr")] : [];
      menu.replaceChildren(...goals, ...divider, ...others);
      const title = words.say(goals.length ? "do.places" : "do.map_options");
      write(element("places-toggle-text"), title);
    }
  };

  return (state) => {
    const entries = menuFor(state);
    fill(entries);
    const open = state.placesOpen && entries.length > 0 && state.mapOpen;
    toggle.hidden = entries.length === 0 || !state.mapOpen || state.aim !== null;
    toggle.setAttribute("aria-expanded", String(open));
    menu.hidden = !open;
    renderAim(element, words, map, state);
  };
};

/**
 * Shows the two buttons at a point, and its sentence.
 * @param {GetElement} element @param {Words} words @param {Page["map"]} map @param {State} state
 */
const renderAim = (element, words, map, state) => {
  const { aim, mapOpen } = state;
  const bar = element("aim");
  bar.hidden = aim === null || !mapOpen;
  bar.dataset.kind = aim?.kind ?? "";
  const hint = hintFor(state);
  element("aim-text").hidden = hint === null;
  write(element("aim-text"), hint ? words.say(hint.word, hint.values) : "");
  const main = /** @type {HTMLButtonElement} */ (element("aim-main"));
  const docks = aimsAtStation(state);
  const action = aim?.kind === "pose" ? "set_pose" : docks ? "go_home" : "go_here";
  main.dataset.action = action;
  main.hidden = aim === null || aim.x === null;
  main.disabled = action === "go_here" && state.aimRoute?.points.length === 0;
  write(main, words.say(`do.${action}`));
  const at = aim && aim.x !== null && aim.y !== null ? map.screenAt(aim.x, aim.y) : null;
  if (at && !bar.hidden) {
    placeBeside(bar, element("map-panel"), at);
  } else {
    bar.style.transform = "";
  }
};

/** @param {ReturnType<typeof menuFor>[number]} entry @param {Words} words */
const menuButton = ({ action, title, word, pressed }, words) => {
  const button = make("button", "places__entry", title ?? words.say(word ?? ""));
  button.type = "button";
  button.dataset.action = action;
  if (pressed !== undefined) {
    button.setAttribute("aria-pressed", String(pressed));
  }
  return button;
};
