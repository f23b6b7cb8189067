/** The path driven, thinned out: a point every few centimetres, bounded, oldest out first. Pure. */

const STEP = 0.08; // m
const JUMP = 1.5; // m; a robot that found itself somewhere else did not drive there
const MOST = 3000;

export class Trail {
  constructor() {
    /** @type {Point[][]} unbroken pieces */
    this.pieces = [];
    this.length = 0;
  }

  /** @param {number} x @param {number} y @returns {boolean} whether the trail grew */
  add(x, y) {
    const piece = this.pieces.at(-1);
    const last = piece?.at(-1);
    const step = last ? Math.hypot(x - last[0], y - last[1]) : Infinity;
    if (step < STEP) {
      return false;
    }
    if (piece && step < JUMP) {
      piece.push([x, y]);
    } else {
      this.pieces.push([[x, y]]);
    }
    this.length += 1;
    this.#forget();
    return true;
  }

  #forget() {
    while (this.length > MOST) {
      this.pieces[0].shift();
      this.length -= 1;
      if (this.pieces[0].length === 0) {
        this.pieces.shift();
      }
    }
  }
}
