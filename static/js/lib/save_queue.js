/**
 * Changes that are sent to the server in order, and again until they arrive. Until then each is
 * stored in the browser, so that a reload, a closed tab or a lost network loses nothing. The server
 * knows a change by its id, so that one that is sent twice counts once.
 */

import { attempt } from "./storage.js";

const SHORTEST_S = 1;
const LONGEST_S = 15;

/**
 * @typedef {"saving" | "saved" | "waiting" | "refused" | "signed_out"} SaveState
 *
 * @typedef {object} Outcome of a request
 * @property {SaveState} state `waiting`: there was no answer, send it again
 * @property {boolean} [isDone] whether the server has the changes, or will never accept them
 * @property {any} [body] the server's answer
 */

/** @template {{id: string}} Change */
export class SaveQueue {
  /**
   * @param {object} options @param {Storage | null} options.storage
   * @param {string} options.key prefix of the names in the storage
   * @param {(changes: Change[]) => Promise<Outcome>} options.send does not reject
   * @param {(state: SaveState, changes: Change[], outcome: Outcome | null) => void} options.onState
   * @param {number} [options.most] changes at once
   * @param {(old: Change, change: Change) => boolean} [options.replaces] whether a change makes an
   *   older one needless
   * @param {(seconds: number, then: () => void) => void} [options.later]
   * @param {() => number} [options.now] ms
   */
  constructor({
    storage,
    key,
    send,
    onState,
    most = 200,
    replaces = () => false,
    later = (seconds, then) => setTimeout(then, seconds * 1000),
    now = Date.now,
  }) {
    this.storage = storage;
    this.key = key;
    this.send = send;
    this.onState = onState;
    this.most = most;
    this.replaces = replaces;
    this.later = later;
    this.now = now;
    this.count = 0;
    this.wait = SHORTEST_S;
    this.isSending = false;
    this.isWaiting = false;
    /** @type {((isSaved: boolean) => void)[]} */
    this.asking = [];
    /** @type {{name: string, change: Change}[]} */
    this.entries = this.#stored();
  }

  /** @returns {Change[]} */
  get pending() {
    return this.entries.map(({ change }) => change);
  }

  /** @param {Change[]} changes */
  add(changes) {
    for (const change of changes) {
      this.count += 1;
      const at = String(this.now()).padStart(15, "0");
      const name = `${this.key}:${at}:${String(this.count).padStart(6, "0")}:${change.id}`;
      this.#drop(this.entries.filter(({ change: old }) => this.replaces(old, change)));
      this.entries.push({ name, change });
      attempt(() => this.storage?.setItem(name, JSON.stringify(change)));
    }
    this.flush();
  }

  /** Sends all changes. @returns {Promise<boolean>} whether the server has them */
  settled() {
    if (!this.entries.length) {
      return Promise.resolve(true);
    }
    const answer = new Promise((resolve) => this.asking.push(resolve));
    this.flush();
    return answer;
  }

  /** Sends pending changes, if any; call it also when the network is back. */
  async flush() {
    if (this.isSending || !this.entries.length) {
      return;
    }
    this.isSending = true;
    const sent = this.entries.slice(0, this.most);
    const changes = sent.map(({ change }) => change);
    this.onState("saving", changes, null);
    const outcome = await this.send(changes);
    this.isSending = false;
    if (outcome.isDone) {
      this.wait = SHORTEST_S;
      this.#drop(sent);
    } else if (outcome.state === "waiting") {
      this.#again();
    }
    this.onState(outcome.state, changes, outcome);
    if (!outcome.isDone || !this.entries.length) {
      this.asking.splice(0).forEach((resolve) => resolve(outcome.state === "saved"));
    } else {
      this.flush();
    }
  }

  #again() {
    if (!this.isWaiting) {
      this.isWaiting = true;
      this.later(this.wait, () => {
        this.isWaiting = false;
        this.flush();
      });
      this.wait = Math.min(2 * this.wait, LONGEST_S);
    }
  }

  /** @param {{name: string}[]} entries */
  #drop(entries) {
    const names = new Set(entries.map(({ name }) => name));
    this.entries = this.entries.filter(({ name }) => !names.has(name));
    names.forEach((name) => attempt(() => this.storage?.removeItem(name)));
  }

  /** @returns {{name: string, change: Change}[]} */
  #stored() {
    const names = attempt(() => Object.keys(this.storage ?? {})) ?? [];
    const own = names.filter((name) => name.startsWith(`${this.key}:`)).sort();
    return own.flatMap((name) => {
      const change = attempt(() => JSON.parse(this.storage?.getItem(name) ?? "null"));
      return typeof change?.id === "string" ? [{ name, change }] : [];
    });
  }
}
