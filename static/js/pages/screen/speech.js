/**
 * The display's voice: what a visitor writes to be spoken, with the browser's own speech; without one the words are only shown.
 */

/**
 * @param {object} [browser]
 * @param {SpeechSynthesis | undefined} [browser.synthesis]
 * @param {typeof SpeechSynthesisUtterance | undefined} [browser.Utterance]
 */
export const createVoice = ({ synthesis = globalThis.speechSynthesis, Utterance = globalThis.SpeechSynthesisUtterance } = {}) => ({
  /** @param {string} text @param {string} language a BCP 47 tag @param {number} volume 0 to 1 @returns {boolean} whether it is spoken */
  speak: (text, language, volume) => {
    if (!synthesis || !Utterance || volume <= 0) {
      return false;
    }
    const utterance = new Utterance(text);
    utterance.lang = language;
    utterance.volume = volume;
    synthesis.speak(utterance);
    return true;
  },
  hush: () => synthesis?.cancel(),
});
