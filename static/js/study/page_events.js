/**
 * What the page adds to the record of a drive: how it was laid out, what was hidden, which
 * sentences were shown for how long, and which controller was taken up. Pure: it says what to write
 * down, recorder.js sends it. Times are Unix seconds by the page's clock.
 */

const LEAST_SHOWN = 0.3; // s; what flickers by was not read

/** @typedef {{type: string, data: Record<string, string | number | boolean | null>}} Note */

/** One place of the page where sentences follow each other. */
export class Shown {
  /** @param {string} type of the note */
  constructor(type) {
    this.type = type;
    this.word = "";
    this.number = /** @type {number | null} */ (null);
    this.since = 0;
  }

  /**
   * @param {string} word nothing when none is shown
   * @param {number | null} number @param {number} now
   * @returns {Note | null} the sentence that has gone
   */
  hear(word, number, now) {
    if (word === this.word && number === this.number) {
      return null;
    }
    const seconds = now - this.since;
    const gone =
      this.word && seconds >= LEAST_SHOWN
        ? {
            type: this.type,
            data: {
              word: this.word,
              number: this.number,
              seconds: Math.round(seconds * 1000) / 1000,
            },
          }
        : null;
    Object.assign(this, { word, number, since: now });
    return gone;
  }
}

/** Something that is written down whenever it changes. */
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

  /** A new visit begins: everything is said again. */
  reset() {
    this.last = "";
  }
}

/**
 * Which of the page's layouts that is: static/css/drive.css.
 * @param {number} width CSS pixels
 * @param {number} height
 */
export const layoutOf = (width, height) =>
  height <= 540 && width >= height ? "low" : width <= 999 ? "upright" : "wide";
