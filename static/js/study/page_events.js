/**
 * Events of the page for the record of a drive: its layout, what was hidden, which sentences were
 * shown for how long, and which controller was used. Pure; sent by recorder.js. Times are Unix
 * seconds by the page's clock.
 */

const LEAST_SHOWN = 0.3; // s; a sentence shown for less was not read

/** @typedef {{type: string, data: Record<string, string | number | boolean | null>}} Note */

/** A place of the page that shows one sentence after another. */
export class Shown {
  /** @param {string} type of the note */
  constructor(type) {
    this.type = type;
    this.word = "";
    this.number = /** @type {number | null} */ (null);
    this.since = 0;
  }

  /**
   * @param {string} word empty when none is shown
   * @param {number | null} number @param {number} now
   * @returns {Note | null} of the sentence that was removed
   */
  hear(word, number, now) {
    if (word === this.word && number === this.number) {
      return null;
    }
    const seconds = Math.round((now - this.since) * 1000) / 1000;
    const data = { word: this.word, number: this.number, seconds };
    Object.assign(this, { word, number, since: now });
    return data.word && seconds >= LEAST_SHOWN ? { type: this.type, data } : null;
  }
}

/** A value that is recorded whenever it changes. */
export class Changes {
  /** @param {string} type */
  constructor(type) {
    this.type = type;
    this.last = "";
  }

  /** @param {Note["data"]} data @returns {Note | null} */
  hear(data) {
    const now = JSON.stringify(data);
    const changed = now !== this.last;
    this.last = now;
    return changed ? { type: this.type, data } : null;
  }

  /** A new session starts. */
  reset() {
    this.last = "";
  }
}

/** The layout of static/css/drive.css. @param {number} width CSS pixels @param {number} height */
export const layoutOf = (width, height) =>
  height <= 540 && width >= height ? "low" : width <= 999 ? "upright" : "wide";
