/** On the map: the menu of places and other actions, and the two buttons for a chosen point. */

import { roleOf } from "../protocol/session.js";
import { maySend, can } from "../protocol/capabilities.js";
import { make, write } from "../lib/dom.js";
import { assistIn } from "./assistance.js";
import { profileOf } from "../view/display/profiles.js";

/**
 * What the menu holds. Pure.
 * @param {State} state
 * @returns {{action: string, title?: string, word?: string, pressed?: boolean, aside?: boolean}[]}
 *   a place has a title, other entries a word; those that are no destination are aside
 */
export const menuFor = (state) => {
  const drives = roleOf(state.visit) === "driver";
  const places =
    drives && can(state, "goto") && maySend(state, "places") ? (state.plan?.places ?? []) : [];
  const goes = places.length > 0 || (drives && can(state, "dock"));
  if (state.study && !goes) {
    // who is asked to drive finds nothing else to do on the map; a lost robot asks by itself
    return [];
  }
  return [
    ...(drives && can(state, "dock") && !state.robot?.docked
      ? [{ action: "go_home", word: "do.go_home" }]
      : []),
    ...places.map((/** @type {any} */ { name, title }) => ({
      action: `go_to:${name}`,
      title: title || name,
    })),
    ...(drives && can(state, "relocalize")
      ? [{ action: "show_pose", word: "do.show_pose_menu", aside: true }]
      : []),
    ...(drives && can(state, "scan")
      ? [{ action: "laser", word: "do.laser", pressed: showsLaser(state), aside: true }]
      : []),
  ];
};

/**
 * Whether laser points are drawn: as the visitor chose, else as the profile says, else while the
 * robot assists.
 * @param {State} state
 */
export const showsLaser = (state) =>
  state.laser ?? profileOf(state).laser ?? !["", "off"].includes(assistIn(state));

/**
 * The sentence about a point of the map; how to give it a direction only until the visitor has done
 * so, as the sentence covers part of the map. Pure.
 * @param {State} state
 * @returns {string} a word, or nothing
 */
export const hintFor = ({ aim, hasAimed }) => {
  if (aim === null || aim.x === null) {
    return aim?.kind === "pose" ? "aim.pose_first" : "";
  }
  return hasAimed ? "" : `aim.${aim.kind}`;
};

/**
 * @param {GetElement} element @param {Words} words @param {(action: string) => void} act
 * @param {KeyDispatcher} keys @returns {(state: State) => void}
 */
export const createMapBar = (element, words, act, keys) => {
  const [toggle, menu, bar] = [element("places-toggle"), element("places"), element("aim")];
  const viewport = element("viewport");
  let drawn = "";
  const close = () => {
    act("places");
    viewport.focus({ preventScroll: true });
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
        viewport.focus({ preventScroll: true });
      }
    });
  }

  /** @param {ReturnType<typeof menuFor>} entries */
  const fill = (entries) => {
    const key = JSON.stringify(entries);
    if (key !== drawn) {
      drawn = key;
      const [aside, goals] = [
        entries.filter((entry) => entry.aside),
        entries.filter((entry) => !entry.aside),
      ];
      const divider = goals.length && aside.length ? [make("hr")] : [];
      menu.replaceChildren(
        ...goals.map((entry) => menuButton(entry, words)),
        ...divider,
        ...aside.map((entry) => menuButton(entry, words)),
      );
      write(
        element("places-toggle-text"),
        words.say(goals.length ? "do.places" : "do.map_options"),
      );
    }
  };

  return (state) => {
    const entries = menuFor(state);
    fill(entries);
    const open = state.placesOpen && entries.length > 0 && state.mapOpen;
    toggle.hidden = entries.length === 0 || !state.mapOpen || state.aim !== null;
    toggle.setAttribute("aria-expanded", String(open));
    menu.hidden = !open;
    renderAim(element, words, state);
  };
};

/**
 * The two buttons for a point, and its sentence.
 * @param {GetElement} element @param {Words} words @param {State} state
 */
const renderAim = (element, words, state) => {
  const { aim, mapOpen } = state;
  const bar = element("aim");
  bar.hidden = aim === null || !mapOpen;
  bar.dataset.kind = aim?.kind ?? "";
  const hint = hintFor(state);
  element("aim-text").hidden = hint === "";
  write(element("aim-text"), hint && words.say(hint));
  const main = /** @type {HTMLButtonElement} */ (element("aim-main"));
  main.dataset.action = aim?.kind === "pose" ? "set_pose" : "go_here";
  main.hidden = aim === null || aim.x === null;
  write(main, words.say(aim?.kind === "pose" ? "do.set_pose" : "do.go_here"));
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
