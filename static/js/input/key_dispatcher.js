/**
 * The keys of the pages that drive or replay, and the one rule about them: no key drives, tilts,
 * talks or changes anything while a text field, a dialog or a menu is open. All key listeners are
 * added here, and `keyUse` alone has the rule.
 *
 * - Keys that type belong to the field, keys with Ctrl, Alt or Meta to the browser, and keys that
 *   compose a character to the input method.
 * - When a holder (a dialog, a menu) opens, pressed keys count as released, so the robot stops.
 *   After it closes, a key must be released and pressed again.
 * - The key that stops the robot (the space bar) always does, unless it types or ticks.
 * - Escape closes the holder, or another open panel. A press beside a menu closes it.
 *
 * Dialogs and open <details> are holders; others have `data-holds-keys` in their template.
 */

import { guarded } from "../lib/errors.js";
import { Keymap } from "./keymap.js";

const HOLDERS = "[data-holds-keys], dialog[open], details[open]";
// sliders, boxes and the map use keys themselves
const OWN = "input, [data-own-keys]";
const TICKED = "input[type='checkbox'], input[type='radio']";
const USUAL = new Keymap();
const TYPED = [
  "input:not([type='range'], [type='checkbox'], [type='radio'])",
  "textarea",
  "select",
  "[contenteditable]:not([contenteditable='false'])",
].join();

/**
 * Whether a key is combined with Ctrl, Alt or Meta, or composes a character (229: in browsers that
 * do not report it).
 * @param {any} event
 */
export const isShortcut = (event) =>
  Boolean(
    event.ctrlKey || event.metaKey || event.altKey || event.isComposing || event.keyCode === 229,
  );

/** The last open holder of the page, or null. @param {ParentNode} root @returns {Element | null} */
export const openHolder = (root) =>
  Array.from(root.querySelectorAll(HOLDERS)).filter(isShown).at(-1) ?? null;

/** @param {Element} element */
const isShown = (element) =>
  element.closest("[hidden]") === null && (element.checkVisibility?.() ?? true);

/**
 * What a pressed key is for: the page (`free`), stopping the robot (`stop`), or something else.
 * @param {any} event keydown
 * @param {Element | null} holder @param {Keymap} [keymap]
 * @returns {"free" | "stop" | "text" | "shortcut" | "own" | "held"}
 */
export const keyUse = (event, holder, keymap = USUAL) => {
  const on = (/** @type {string} */ selector) => Boolean(event.target?.closest?.(selector));
  if (on(TYPED)) {
    return "text";
  }
  if (isShortcut(event)) {
    return "shortcut";
  }
  if (keymap.commandOf(event) === "stop" && !(event.code === "Space" && on(TICKED))) {
    return "stop";
  }
  if (holder) {
    return "held";
  }
  return on(OWN) ? "own" : "free";
};

/**
 * The keys of a page that drives nothing, by the same rule.
 * @param {(event: KeyboardEvent) => boolean} down whether the key has an effect
 */
export const onPageKey = (down) =>
  document.addEventListener("keydown", (event) => {
    const holder = openHolder(document);
    const isOther = ["text", "shortcut"].includes(keyUse(event, holder));
    if (!holder && !isOther && down(event)) {
      event.preventDefault();
    }
  });

/**
 * @typedef {{down: (event: KeyboardEvent) => void, up?: (event: KeyboardEvent) => void,
 *   letGo?: () => void}} KeyHandler
 */

export class KeyDispatcher {
  /**
   * @param {object} [options] @param {Keymap} [options.keymap]
   * @param {EventTarget} [options.target] of the key events
   * @param {any} [options.root] the document
   * @param {(onChange: () => void) => void} [options.watch] calls when something of the page is
   *   shown or hidden
   */
  constructor({
    keymap = USUAL,
    target = window,
    root = document,
    watch = (onChange) => watchShown(root, onChange),
  } = {}) {
    this.keymap = keymap;
    this.root = root;
    /** @type {Set<KeyHandler>} */
    this.users = new Set();
    /** @type {Map<Element, {close: () => void, beside: (() => void) | null}>} */
    this.closers = new Map();
    /** @type {Set<string>} codes of the keys that went to the users and are down */
    this.down = new Set();
    this.wasOpen = false;
    target.addEventListener("keydown", (/** @type {any} */ event) => this.#press(event));
    target.addEventListener("keyup", (/** @type {any} */ event) => this.#release(event));
    // without it, a missed release would go on driving, or leave the microphone open
    target.addEventListener("blur", () => this.letGo());
    target.addEventListener("focusin", (event) => keyUse(event, null) === "text" && this.letGo());
    target.addEventListener("pointerdown", (event) => this.#pressBeside(event), { capture: true });
    watch(() => this.#watchHolder());
  }

  /** @param {KeyHandler} user */
  add(user) {
    this.users.add(user);
  }

  /** @param {Record<string, KeyHandler>} commands handlers by the command of the key */
  addCommands(commands) {
    const handlerOf = (/** @type {KeyboardEvent} */ event) =>
      commands[this.keymap.commandOf(event)];
    if (Object.keys(commands).length) {
      this.add({
        down: (event) => handlerOf(event)?.down(event),
        up: (event) => handlerOf(event)?.up?.(event),
        letGo: () => Object.values(commands).forEach((handler) => handler.letGo?.()),
      });
    }
  }

  /** @param {KeyHandler} user */
  remove(user) {
    this.users.delete(user);
  }

  /**
   * How a panel is closed, which may take the keys.
   * @param {Element} holder
   * @param {() => void} close for Escape, gives the focus back
   * @param {(() => void) | null} [beside] for a press beside it
   */
  closes(holder, close, beside = null) {
    this.closers.set(holder, { close, beside });
  }

  /** Whether a holder is open or a text field has the focus. */
  get taken() {
    return (
      openHolder(this.root) !== null || keyUse({ target: this.root.activeElement }, null) === "text"
    );
  }

  /** Every key counts as released. */
  letGo() {
    this.down.clear();
    this.users.forEach((user) => guarded(() => user.letGo?.()));
  }

  /** @param {KeyboardEvent} event */
  #press(event) {
    const holder = openHolder(this.root);
    const panel = event.key === "Escape" && !isShortcut(event) && (holder ?? this.#lastPanel());
    if (panel) {
      this.closers.get(panel)?.close();
      return;
    }
    const use = keyUse(event, holder, this.keymap);
    if (use === "shortcut") {
      this.letGo(); // the release of other keys may be missed
    }
    if ((use === "free" || use === "stop") && (!event.repeat || this.down.has(event.code))) {
      this.down.add(event.code);
      this.users.forEach((user) => guarded(() => user.down(event)));
    }
  }

  /** @param {KeyboardEvent} event */
  #release(event) {
    this.down.delete(event.code);
    this.users.forEach((user) => guarded(() => user.up?.(event)));
  }

  #lastPanel() {
    return Array.from(this.closers.keys()).filter(isShown).at(-1);
  }

  #watchHolder() {
    const isOpen = openHolder(this.root) !== null;
    if (isOpen && !this.wasOpen) {
      this.letGo();
    }
    this.wasOpen = isOpen;
  }

  /** @param {any} event */
  #pressBeside({ target }) {
    const holder = openHolder(this.root);
    if (
      holder &&
      !holder.contains(target) &&
      !target.closest?.(`[aria-controls~="${holder.id}"]`)
    ) {
      this.closers.get(holder)?.beside?.();
    }
  }
}

/** @param {Node} root @param {() => void} onChange */
const watchShown = (root, onChange) =>
  new MutationObserver(onChange).observe(root, {
    subtree: true,
    attributes: true,
    attributeFilter: ["hidden", "open", "data-holds-keys"],
  });
