/** Fetches the address of a photo of the robot, which the server may receive a moment later. */

import { fetchJson } from "../lib/page_poll.js";

const FIRST = 0.3; // s until the next request
const SLOWEST = 2;

export class Snapshots {
  /**
   * @param {object} options
   * @param {string} options.list the address of the list of the visitor's photos
   * @param {(actionId: string, url: string) => void} options.onFound
   * @param {(url: string) => Promise<any>} [options.fetch] @param {typeof setTimeout}
   *   [options.later]
   */
  constructor({ list, onFound, fetch = fetchJson, later = setTimeout.bind(globalThis) }) {
    this.list = list;
    this.onFound = onFound;
    this.fetch = fetch;
    this.later = later;
    this.wanted = "";
  }

  /**
   * Requests a photo until it is found, or another one or none is wanted.
   * @param {string} actionId
   */
  want(actionId) {
    if (actionId !== this.wanted) {
      this.wanted = actionId;
      if (actionId) {
        void this.#poll(actionId, FIRST);
      }
    }
  }

  /** @param {string} actionId @param {number} pause s */
  async #poll(actionId, pause) {
    const { snapshots } = await this.fetch(this.list).catch(() => ({ snapshots: [] }));
    const found = snapshots.find((/** @type {any} */ one) => one.actionId === actionId);
    if (actionId !== this.wanted) {
      return;
    }
    if (found) {
      this.onFound(actionId, found.url);
    } else {
      const next = () => void this.#poll(actionId, Math.min(SLOWEST, pause * 1.5));
      this.later(() => actionId === this.wanted && next(), pause * 1000);
    }
  }
}
