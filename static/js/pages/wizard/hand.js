/** Driving by hand: the held keys or buttons, and their velocity. */

const SHARE = 0.6; // of the robot's largest speeds

/** @typedef {"forward" | "backward" | "left" | "right"} Direction as in input/keymap.js */
const DIRECTIONS = ["forward", "backward", "left", "right"];

export class Hand {
  /** @param {{onChange: () => void}} options */
  constructor({ onChange }) {
    this.onChange = onChange;
    /** @type {Set<Direction>} */
    this.held = new Set();
    this.method = "keyboard";
  }

  /** @param {string} command of a key @returns {Direction | null} */
  static directionOf(command) {
    return DIRECTIONS.includes(command) ? /** @type {Direction} */ (command) : null;
  }

  /** @param {Direction} direction @param {"keyboard" | "touch"} method */
  press(direction, method) {
    this.method = method;
    this.held.add(direction);
    this.onChange();
  }

  /** @param {Direction} direction */
  release(direction) {
    if (this.held.delete(direction)) {
      this.onChange();
    }
  }

  letGo() {
    if (this.held.size) {
      this.held.clear();
      this.onChange();
    }
  }

  /** m/s and rad/s. @param {{linear: number, reverse: number, angular: number}} limits */
  velocity(limits) {
    const sign = (/** @type {Direction} */ one, /** @type {Direction} */ other) =>
      Number(this.held.has(one)) - Number(this.held.has(other));
    const ahead = sign("forward", "backward");
    return {
      linear: SHARE * ahead * (ahead < 0 ? limits.reverse : limits.linear),
      angular: SHARE * sign("left", "right") * limits.angular,
      method: this.method,
    };
  }
}
