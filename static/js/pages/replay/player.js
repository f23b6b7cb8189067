/**
 * What plays: a moment, a speed, and whether time goes on. Pure; the page tells it how much real
 * time has passed.
 */

import { clamp } from "./timeline.js";

export const SPEEDS = [0.5, 1, 2, 4, 8, 16];

/** @typedef {{t: number, playing: boolean, speed: number, duration: number}} Player s */

/** @param {number} duration s @param {number} [t] s @returns {Player} */
export const newPlayer = (duration, t = 0) => ({
  t: clamp(t, duration),
  playing: false,
  speed: 1,
  duration,
});

/** @param {Player} player @param {number} t @returns {Player} */
export const seek = (player, t) => ({ ...player, t: clamp(t, player.duration) });

/** Play or pause; at the end it begins again. @param {Player} player @returns {Player} */
export const toggle = (player) => {
  const again = !player.playing && player.t >= player.duration;
  return { ...player, playing: !player.playing && player.duration > 0, t: again ? 0 : player.t };
};

/** @param {Player} player @param {number} speed @returns {Player} */
export const setSpeed = (player, speed) => (SPEEDS.includes(speed) ? { ...player, speed } : player);

/** @param {Player} player @param {number} seconds of real time @returns {Player} */
export const advance = (player, seconds) => {
  if (!player.playing) {
    return player;
  }
  const t = clamp(player.t + Math.max(0, seconds) * player.speed, player.duration);
  return { ...player, t, playing: t < player.duration };
};

/**
 * What a key does to it; the same player where it does nothing.
 * @param {Player} player @param {string} key @param {boolean} shift @returns {Player}
 */
export const pressed = (player, key, shift) => {
  const step = shift ? 10 : 1;
  const turn = SPEEDS.indexOf(player.speed);
  switch (key) {
    case " ":
    case "k":
      return toggle(player);
    case "ArrowLeft":
      return seek(player, player.t - step);
    case "ArrowRight":
      return seek(player, player.t + step);
    case "Home":
      return seek(player, 0);
    case "End":
      return seek(player, player.duration);
    case "+":
      return setSpeed(player, SPEEDS[turn + 1]);
    case "-":
      return setSpeed(player, SPEEDS[turn - 1]);
    default:
      return player;
  }
};
