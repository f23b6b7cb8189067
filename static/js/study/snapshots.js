/**
 * Fetches the address of a picture that the robot has taken: it is there once the server has it
 * whole, which may take a moment.
 */

const FIRST = 0.3; // s until it is asked again
const SLOWEST = 2;

export class Snapshots {
  /**
   * @param {object} options
   * @param {string} options.list the address of the list of one's own pictures
   * @param {(actionId: string, url: string) => void} options.onFound
   * @param {(url: string) => Promise<{ok: boolean, json: () => Promise<any>}>} [options.fetch]
   * @param {(callback: () => void, ms: number) => unknown} [options.later]
   */
  constructor({
    list,
    onFound,
    fetch = (url) => globalThis.fetch(url, { credentials: "same-origin" }),
    later = setTimeout.bind(globalThis),
  }) {
    this.list = list;
    this.onFound = onFound;
    this.fetch = fetch;
    this.later = later;
    this.wanted = "";
  }

  /**
   * Look for a picture until it is found, or another one, or none, is wanted.
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
    const url = await this.#address(actionId);
    if (actionId !== this.wanted) {
      return;
    }
    if (url) {
      this.onFound(actionId, url);
    } else {
      this.later(
        () => actionId === this.wanted && void this.#poll(actionId, Math.min(SLOWEST, pause * 1.5)),
        pause * 1000,
      );
    }
  }

  /**
   * @param {string} actionId
   * @returns {Promise<string | null>} null while it is not there, or the server is not
   */
  async #address(actionId) {
    try {
      const answer = await this.fetch(this.list);
      const { snapshots } = answer.ok ? await answer.json() : { snapshots: [] };
      return snapshots.find((/** @type {any} */ one) => one.actionId === actionId)?.url ?? null;
    } catch (error) {
      if (error instanceof TypeError || error instanceof SyntaxError) {
        return null; // no network, or an error page where the list should be
      }
      throw error;
    }
  }
}
