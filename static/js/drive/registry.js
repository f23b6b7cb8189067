/**
 * What the features of the drive page provide: handlers for messages, actions for buttons, keys, a
 * render function and listeners to events of the page. Only page.js knows which features exist. A
 * feature that is loaded later gets the messages and events from before. An error in a feature
 * stops neither the other features nor the caller.
 */

import { guarded } from "../lib/errors.js";

/** Repeated soon, and therefore not kept for later features. */
const PASSING = new Set([
  ...["changed", "tick", "poll", "second", "frameShown", "newRobotState"],
  ...["state", "pose", "scan", "heartbeat", "media", "picture"],
]);

export class Registry {
  constructor() {
    /** @type {Map<string, ((message: any, transport: Transport) => unknown)[]>} */
    this.handlers = new Map();
    /** @type {Map<string, (argument: string) => void>} */
    this.actions = new Map();
    /** @type {((state: any) => void)[]} */
    this.renders = [];
    /** @type {Map<string, ((...values: any[]) => void)[]>} */
    this.listeners = new Map();
    /** @type {["handle" | "emit", any[]][] | null} for later features; null once all are set up */
    this.past = [];
  }

  /** @param {FeatureParts} parts */
  add(parts) {
    this.#take(parts);
    const late = new Registry();
    late.#take(parts);
    [...(this.past ?? [])].forEach(([what, values]) => /** @type {any} */ (late)[what](...values));
  }

  /** All features are set up. */
  complete() {
    this.past = null;
  }

  /** @param {FeatureParts} parts */
  #take({ handlers = {}, actions = {}, render, on = {} }) {
    Object.entries(handlers).forEach(([suffix, handler]) => append(this.handlers, suffix, handler));
    Object.entries(on).forEach(([name, listener]) => append(this.listeners, name, listener));
    Object.entries(actions).forEach(([name, action]) => this.actions.set(name, action));
    if (render) {
      this.renders.push(render);
    }
  }

  /**
   * @param {string} suffix @param {any} message @param {any} transport
   * @returns {boolean} whether a feature takes such messages
   */
  handle(suffix, message, transport) {
    this.#keep("handle", [suffix, message, transport]);
    const handlers = this.handlers.get(suffix);
    handlers?.forEach((handler) => guarded(() => handler(message, transport)));
    return handlers !== undefined;
  }

  /**
   * An action, or one with an argument: `speed-2`, `go_to:kitchen`.
   * @param {string} action
   * @returns {boolean} whether a feature has it
   */
  act(action) {
    const [, name, argument] = this.actions.has(action)
      ? ["", action, ""]
      : (/^([^:-]+)[:-](.*)$/.exec(action) ?? []);
    const run = this.actions.get(name ?? "");
    guarded(() => run?.(argument ?? ""));
    return run !== undefined;
  }

  /** @param {string} name @param {any[]} values */
  emit(name, ...values) {
    this.#keep("emit", [name, ...values]);
    this.listeners.get(name)?.forEach((listener) => guarded(() => listener(...values)));
  }

  /** @param {"handle" | "emit"} what @param {[string, ...any[]]} values */
  #keep(what, values) {
    if (!PASSING.has(values[0])) {
      this.past?.push([what, values]);
    }
  }

  /** @param {any} state */
  render(state) {
    this.renders.forEach((render) => guarded(() => render(state)));
  }
}

/** @template T @param {Map<string, T[]>} lists @param {string} name @param {T} one */
const append = (lists, name, one) => {
  lists.set(name, [...(lists.get(name) ?? []), one]);
};
