/**
 * The keys of the drive page by command: for driving, and for the hints on the page. Keys that the
 * visitor has chosen replace them. A key is a place on the keyboard (KeyboardEvent.code), which
 * works on every layout, or a character (KeyboardEvent.key).
 */

import { make } from "../lib/dom.js";

/** @type {Readonly<Record<string, readonly string[]>>} the hints show the first key of a line */
export const DEFAULTS = Object.freeze({
  forward: ["ArrowUp", "KeyW"],
  left: ["ArrowLeft", "KeyA"],
  backward: ["ArrowDown", "KeyS"],
  right: ["ArrowRight", "KeyD"],
  stop: ["Space"],
  faster: ["Equal", "NumpadAdd", "BracketRight"],
  slower: ["Minus", "NumpadSubtract", "Slash"],
  talk: ["KeyT"],
  turn_around: ["KeyU"],
  look_up: ["KeyR"],
  look_down: ["KeyF"],
});

/** While the map has the focus. */
export const MAP_DEFAULTS = Object.freeze({
  map_up: ["ArrowUp"],
  map_down: ["ArrowDown"],
  map_left: ["ArrowLeft"],
  map_right: ["ArrowRight"],
  map_in: ["+"],
  map_out: ["-"],
  map_all: ["0"],
});

// prettier-ignore
const SIGNS = /** @type {Record<string, string>} */ ({
  ArrowUp: "↑", ArrowLeft: "←", ArrowDown: "↓", ArrowRight: "→",
  Space: "␣", Equal: "+", Minus: "−",
  NumpadAdd: "+", NumpadSubtract: "−", NumpadMultiply: "×", NumpadDivide: "÷", NumpadDecimal: ".",
  BracketLeft: "[", BracketRight: "]", Slash: "/", Backslash: "\\", Semicolon: ";", Quote: "'",
  Comma: ",", Period: ".", Backquote: "`",
});

/** The label of a key, as far as it is the same on all keyboards. @param {string} key */
export const labelOf = (key) => SIGNS[key] ?? key.replace(/^(?:Key|Digit|Numpad)/, "");

/** Keys that the browser or the page needs, and those that combine with others. */
const NEVER = [
  /^(?:|Escape|Tab|Enter|NumpadEnter|F\d+|ContextMenu|CapsLock|NumLock|ScrollLock)$/,
  /^(?:Alt|Control|Shift|Meta|OS|Browser|Media|Audio)/,
];

export class Keymap {
  mapCommands = invert(MAP_DEFAULTS);
  /** @type {Record<string, readonly string[]>} */
  keys = DEFAULTS;
  /** @type {Map<string, string>} */
  commands = new Map();

  /** @param {Record<string, string[]>} [own] */
  constructor(own = {}) {
    this.use(own);
  }

  /**
   * Uses a visitor's keys.
   * @param {Record<string, string[]>} own by command; other commands keep keys that are not taken.
   *   There is always a key that stops the robot.
   */
  use(own) {
    const taken = new Set(Object.keys(DEFAULTS).flatMap((command) => own[command] ?? []));
    const keysOf = (/** @type {[string, readonly string[]]} */ [command, keys]) => [
      command,
      own[command] ?? keys.filter((key) => !taken.has(key)),
    ];
    this.keys = Object.fromEntries(Object.entries(DEFAULTS).map(/** @type {any} */ (keysOf)));
    if (!this.keys.stop.length) {
      this.keys.stop = DEFAULTS.stop;
    }
    this.own = own;
    this.commands = invert({ ...this.keys, stop: [] });
    this.keys.stop.forEach((key) => this.commands.set(key, "stop"));
  }

  /**
   * Why a key may not be chosen for a command: "never" for any, or because it is the only one that
   * stops the robot.
   * @param {string} command @param {string} key
   */
  refuses(command, key) {
    if (NEVER.some((one) => one.test(key))) {
      return "never";
    }
    return command !== "stop" && this.keys.stop.every((one) => one === key) ? "stop" : "";
  }

  /**
   * The visitor's keys with one more: it is this command's alone, and its only one.
   * @param {string} command @param {string} key
   */
  withKey(command, key) {
    const others = Object.entries(this.keys).filter(([, keys]) => keys.includes(key));
    const freed = others.map(([other, keys]) => [other, keys.filter((one) => one !== key)]);
    return /** @type {Record<string, string[]>} */ ({
      ...this.own,
      ...Object.fromEntries(freed),
      [command]: [key],
    });
  }

  /** @param {{code: string, key?: string}} event @returns {string} empty for a key of no command */
  commandOf({ code, key = "" }) {
    return this.commands.get(code) ?? this.commands.get(key) ?? "";
  }

  /** The same while the map has the focus. @param {{code: string, key: string}} event */
  mapCommandOf({ code, key }) {
    return this.mapCommands.get(code) ?? this.mapCommands.get(key) ?? "";
  }

  /** `key_talk` and so on, for sentences. @returns {Record<string, string>} */
  labels() {
    return Object.fromEntries(
      Object.entries(this.keys).map(([command, keys]) => [
        `key_${command}`,
        keys.length ? labelOf(keys[0]) : "–",
      ]),
    );
  }

  /**
   * Writes the keys into the page: `data-keys` names commands, `data-keys-title` is a title with
   * `{key_…}` in it.
   * @param {ParentNode} root
   */
  writeHints(root) {
    const labels = this.labels();
    const all = (/** @type {string} */ selector) =>
      /** @type {NodeListOf<HTMLElement>} */ (root.querySelectorAll(selector));
    for (const hint of all("[data-keys]")) {
      const { keys = "", space } = hint.dataset;
      const first = keys.split(" ").map((command) => this.keys[command][0] ?? "");
      const signs = first.map((key) => (key === "Space" && space) || labelOf(key));
      hint.replaceChildren(...signs.map((sign) => make("kbd", "", sign)));
    }
    for (const titled of all("[data-keys-title]")) {
      const title = titled.dataset.keysTitle ?? "";
      titled.title = title.replace(/\{(\w+)\}/g, (whole, name) => labels[name] ?? whole);
    }
  }
}

/** @param {Record<string, readonly string[]>} keys @returns {Map<string, string>} */
const invert = (keys) =>
  new Map(
    Object.entries(keys).flatMap(([command, list]) =>
      list.map((key) => /** @type {[string, string]} */ ([key, command])),
    ),
  );
