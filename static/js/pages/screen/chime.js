/**
 * The sound of a knock on the robot's display: two notes, E5 and C5, which fade. The robot's own
 * loudspeaker plays the same (robots/agent/media/capture/outputs.py).
 */

const NOTES = [
  { hertz: 659.25, at: 0, lasts: 1.45 },
  { hertz: 523.25, at: 0.45, lasts: 1 },
];
const LEVEL = 0.25;
const RISE = 0.005; // s, so that it does not click

/** @param {() => AudioContext} [newContext] */
export const createChime = (newContext = () => new AudioContext()) => {
  /** @type {AudioContext | null} */
  let context = null;

  /**
   * @param {AudioContext} to @param {{hertz: number, at: number, lasts: number}} note
   * @param {number} volume
   */
  const play = (to, { hertz, at, lasts }, volume) => {
    const begin = to.currentTime + at;
    for (const [times, share] of [
      [1, 1],
      [2, 0.3],
    ]) {
      const oscillator = to.createOscillator();
      const gain = to.createGain();
      oscillator.frequency.value = hertz * times;
      gain.gain.setValueAtTime(0, begin);
      gain.gain.linearRampToValueAtTime(LEVEL * share * volume, begin + RISE);
      gain.gain.setTargetAtTime(0, begin + RISE, 0.2);
      oscillator.connect(gain).connect(to.destination);
      oscillator.start(begin);
      oscillator.stop(begin + lasts);
    }
  };

  return {
    /**
     * @param {number} volume 0 to 1
     * @returns {Promise<boolean>} whether it sounds; a browser may refuse before the first touch
     */
    ring: async (volume) => {
      if (volume <= 0) {
        return false;
      }
      context ??= newContext();
      // The promise of a refused sound stays open until a touch, which must not ring then.
      await Promise.race([context.resume(), new Promise((resolve) => setTimeout(resolve, 500))]);
      if (context.state !== "running") {
        return false;
      }
      NOTES.forEach((note) => play(/** @type {AudioContext} */ (context), note, volume));
      return true;
    },
  };
};
