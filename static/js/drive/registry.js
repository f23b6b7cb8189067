/**
 * What the features of the drive page provide: handlers for messages, actions for buttons, keys, a
 * render function and listeners to events of the page. Only page.js knows which features exist. A
 * feature that is loaded later gets the messages and events from before.
 */

/** Repeated soon, so not kept for later features. */
const PASSING = new Set([
  "tick",
  "poll",
  "second",
  "frameShown",
  "newRobotState",
  "state",
  "pose",
  "scan",
  "heartbeat",
  "media",
  "picture",
]);

/**
 * @typedef {object} Feature one part of the drive page
 * @property {string} name under which the others find what it offers: `page[name]`
 * @property {() => object} [state] its slice of the store; of one that comes later features.js has
 *   it
 * @property {(page: Page) => Parts} setUp
 *
 * @typedef {object} Parts all of them may be left out
 * @property {object} [api] what it offers to other features
 * @property {Record<string, (message: any,
 *   transport: import("../protocol/clock_sync.js").Transport) => void>} [handlers] by a message's
 *   suffix
 * @property {Record<string, (argument: string) => void>} [actions] by the name in `data-action`
 * @property {Record<string, import("../input/key_dispatcher.js").KeyHandler>} [keys] by the command
 *   of input/keymap.js
 * @property {(state: any) => void} [render] state into the page's elements, once a frame
 * @property {Record<string, (...values: any[]) => void>} [on] by the name of what happens
 *
 * @typedef {object} Page what every feature gets, with the `api` of the other features
 * @property {any} config from the template
 * @property {import("../lib/words.js").Words} words
 * @property {(id: string) => HTMLElement} element
 * @property {import("./store.js").Store} store
 * @property {import("../input/key_dispatcher.js").KeyDispatcher} keys
 * @property {(own: Record<string, string[]>) => void} useKeys
 * @property {Registry["handle"]} handle
 * @property {Registry["emit"]} emit
 * @property {(action: string) => void} act
 * @property {() => void} begin
 * @property {any} connection
 * @property {any} session
 * @property {any} video
 * @property {any} driving
 * @property {any} waiting
 * @property {any} map
 * @property {any} autonomy
 * @property {any} presence
 */

export class Registry {
  constructor() {
    /** @type {Map<string, Required<Parts>["handlers"][string][]>} */
    this.handlers = new Map();
    /** @type {Map<string, (argument: string) => void>} */
    this.actions = new Map();
    /** @type {((state: any) => void)[]} */
    this.renders = [];
    /** @type {Map<string, ((...values: any[]) => void)[]>} */
    this.listeners = new Map();
    /**
     * @type {["handle" | "emit", any[]][] | null} what has happened, for features that are still to
     *   come; null once all are there
     */
    this.past = [];
  }

  /** @param {Parts} parts */
  add(parts) {
    this.#take(parts);
    const late = new Registry();
    late.#take(parts);
    [...(this.past ?? [])].forEach(([what, values]) => /** @type {any} */ (late)[what](...values));
  }

  /** All features are there: nothing need be kept for another. */
  complete() {
    this.past = null;
  }

  /** @param {Parts} parts */
  #take({ handlers = {}, actions = {}, render, on = {} }) {
    Object.entries(handlers).forEach(([suffix, handler]) => append(this.handlers, suffix, handler));
    Object.entries(on).forEach(([name, listener]) => append(this.listeners, name, listener));
    Object.entries(actions).forEach(([name, action]) => this.actions.set(name, action));
    if (render) {
      this.renders.push(render);
    }
  }

  /**
   * @param {string} suffix
   * @param {any} message
   * @param {any} transport
   * @returns {boolean} whether a feature takes such messages
   */
  handle(suffix, message, transport) {
    this.#keep("handle", [suffix, message, transport]);
    const handlers = this.handlers.get(suffix);
    handlers?.forEach((handler) => handler(message, transport));
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
    run?.(argument ?? "");
    return run !== undefined;
  }

  /** @param {string} name @param {any[]} values */
  emit(name, ...values) {
    this.#keep("emit", [name, ...values]);
    this.listeners.get(name)?.forEach((listener) => listener(...values));
  }

  /** @param {"handle" | "emit"} what @param {[string, ...any[]]} values */
  #keep(what, values) {
    if (!PASSING.has(values[0])) {
      this.past?.push([what, values]);
    }
  }

  /** @param {any} state */
  render(state) {
    this.renders.forEach((render) => render(state));
  }
}

/** @template T @param {Map<string, T[]>} lists @param {string} name @param {T} one */
const append = (lists, name, one) => {
  lists.set(name, [...(lists.get(name) ?? []), one]);
};
