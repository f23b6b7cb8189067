/**
 * The controller that was used last steers. An older one that is still held does not resume when
 * the newer one is released: it must be released and pressed again, so that the robot never moves
 * without a fresh request.
 */

const STILL = Object.freeze({ linear: 0, angular: 0 });

export class Arbiter {
  /** @param {(intent: Intent) => void} emit */
  constructor(emit) {
    this.emit = emit;
    this.holder = "";
    /** @type {Set<string>} controllers that are held but lost to a newer one */
    this.outdone = new Set();
  }

  /** @param {string} method @param {{linear: number, angular: number}} intent */
  offer(method, { linear, angular }) {
    const still = linear === 0 && angular === 0;
    if (still) {
      this.outdone.delete(method);
    }
    if (method === this.holder) {
      this.holder = still ? "" : method;
      this.emit({ linear, angular, method });
    } else if (!still && !this.outdone.has(method)) {
      this.#outdo(method);
      this.emit({ linear, angular, method });
    }
  }

  /** Stop steering; held controllers must be pressed again. @param {string[]} held */
  release(held = []) {
    const method = this.holder || "keyboard";
    this.outdone = new Set(held);
    this.holder = "";
    this.emit({ ...STILL, method });
  }

  /** @param {string} method */
  #outdo(method) {
    if (this.holder) {
      this.outdone.add(this.holder);
    }
    this.holder = method;
  }
}
