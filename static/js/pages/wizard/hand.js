/**
 * Driving by hand: keys that are held, or buttons. It knows what is held and which velocity that
 * is, and nothing of the network.
 */

const SHARE = 0.6; // of the robot's largest speeds
const KEYS = {
  KeyW: "forward",
  ArrowUp: "forward",
  KeyS: "back",
  ArrowDown: "back",
  KeyA: "left",
  ArrowLeft: "left",
  KeyD: "right",
  ArrowRight: "right",
};

/** @typedef {"forward" | "back" | "left" | "right"} Direction */

export class Hand {
  /** @param {{onChange: () => void}} options */
  constructor({ onChange }) {
    this.onChange = onChange;
    /** @type {Set<Direction>} */
    this.held = new Set();
    this.method = "keyboard";
  }

  /** @param {string} code of a KeyboardEvent @returns {Direction | null} */
  static directionOf(code) {
    return Object.hasOwn(KEYS, code) ? /** @type {any} */ (KEYS)[code] : null;
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
    const ahead = sign("forward", "back");
    return {
      linear: SHARE * ahead * (ahead < 0 ? limits.reverse : limits.linear),
      angular: SHARE * sign("left", "right") * limits.angular,
      method: this.method,
    };
  }
}
