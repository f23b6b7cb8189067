/**
 * Reports activity of a visitor who does not drive (a touch, a key or the wheel anywhere on the
 * page) every few seconds, and at once while the server asks.
 */

const EVERY = 15; // s
const KINDS = ["pointerdown", "keydown", "wheel", "input"];

/**
 * @param {object} options @param {EventTarget} options.target
 * @param {() => number} options.clock s
 * @param {() => boolean} options.isAsked whether the visitor is being asked
 * @param {() => void} options.onSign
 */
export const watchActivity = ({ target, clock, isAsked, onSign }) => {
  let at = -Infinity;
  const sign = () => {
    if (isAsked() || clock() - at >= EVERY) {
      at = clock();
      onSign();
    }
  };
  KINDS.forEach((kind) => target.addEventListener(kind, sign, { capture: true, passive: true }));
};
