/** The state of the player: its time and speed, and whether it plays. Pure. */

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

/** Plays or pauses; at the end it starts again. @param {Player} player @returns {Player} */
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

/** @type {Record<string, (player: Player, step: number, speed: number) => Player>} */
const KEYS = {
  " ": toggle,
  k: toggle,
  ArrowLeft: (player, step) => seek(player, player.t - step),
  ArrowRight: (player, step) => seek(player, player.t + step),
  Home: (player) => seek(player, 0),
  End: (player) => seek(player, player.duration),
  "+": (player, _step, speed) => setSpeed(player, SPEEDS[speed + 1]),
  "-": (player, _step, speed) => setSpeed(player, SPEEDS[speed - 1]),
};

/**
 * The player after a key; the same one where that has no effect.
 * @param {Player} player @param {string} key @param {boolean} shift @returns {Player}
 */
export const pressed = (player, key, shift) =>
  KEYS[key]?.(player, shift ? 10 : 1, SPEEDS.indexOf(player.speed)) ?? player;
