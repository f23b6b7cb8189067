/**
 * Reads messages aloud with the browser's speech synthesis, one after another, to know of each
 * whether it was spoken to its end. A browser without a voice for the language may send no event: a
 * message that does not start or end in time was not spoken.
 */

const BEGINS_WITHIN = 5; // s
const ENDS_WITHIN = 120; // s; 500 characters take a minute

/**
 * @param {object} [browser] @param {SpeechSynthesis | undefined} [browser.synthesis]
 * @param {typeof SpeechSynthesisUtterance | undefined} [browser.Utterance]
 * @param {(call: () => void, seconds: number) => any} [browser.later] returns a timer for `never`
 * @param {(timer: any) => void} [browser.never]
 */
export const createVoice = ({
  synthesis = globalThis.speechSynthesis,
  Utterance = globalThis.SpeechSynthesisUtterance,
  later = (call, seconds) => setTimeout(call, seconds * 1000),
  never = clearTimeout,
} = {}) => {
  /** @type {{utterance: SpeechSynthesisUtterance, onEnd: (spoken: boolean) => void}[]} */
  let queue = [];

  const speakFirst = () => {
    const [first] = queue;
    if (!first || !synthesis) {
      return;
    }
    const { utterance, onEnd } = first;
    /** @type {any} */
    let timer;
    const end = (/** @type {boolean} */ spoken) => {
      never(timer);
      if (queue[0] === first) {
        queue.shift();
        onEnd(spoken);
        speakFirst();
      }
    };
    const giveUp = () => {
      if (queue[0] === first) {
        synthesis.cancel();
        end(false);
      }
    };
    timer = later(giveUp, BEGINS_WITHIN);
    utterance.onstart = () => {
      never(timer);
      timer = later(giveUp, ENDS_WITHIN);
    };
    utterance.onend = () => end(true);
    utterance.onerror = () => end(false);
    synthesis.speak(utterance);
  };

  return {
    /**
     * @param {string} text @param {string} language a BCP 47 tag @param {number} volume 0 to 1
     * @param {(spoken: boolean) => void} [onEnd] called once, with whether it was spoken to its end
     * @returns {boolean} whether it is queued
     */
    speak: (text, language, volume, onEnd = () => undefined) => {
      if (!synthesis || !Utterance || volume <= 0) {
        onEnd(false);
        return false;
      }
      const utterance = Object.assign(new Utterance(text), { lang: language, volume });
      queue.push({ utterance, onEnd });
      if (queue.length === 1) {
        speakFirst();
      }
      return true;
    },
    hush: () => {
      const ended = queue;
      queue = [];
      synthesis?.cancel();
      ended.forEach(({ onEnd }) => onEnd(false));
    },
  };
};
