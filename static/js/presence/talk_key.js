/**
 * Push to talk: the visitor is heard while T is down. T lies apart from the keys that drive, and writing a T in a field is no talking.
 */

const CODE = "KeyT";
const WRITABLE = "input:not([type='range']), textarea, select, [contenteditable]";

export class TalkKey {
  /**
   * @param {object} options
   * @param {EventTarget} options.target where keys are heard; the window
   * @param {(down: boolean) => void} options.onTalk
   */
  constructor({ target, onTalk }) {
    this.onTalk = onTalk;
    this.down = false;
    target.addEventListener("keydown", (event) => this.#press(/** @type {KeyboardEvent} */ (event)));
    target.addEventListener("keyup", (event) => /** @type {KeyboardEvent} */ (event).code === CODE && this.letGo());
    // A release that is not seen would leave the microphone open.
    target.addEventListener("blur", () => this.letGo());
  }

  letGo() {
    if (this.down) {
      this.down = false;
      this.onTalk(false);
    }
  }

  /** @param {KeyboardEvent} event */
  #press(event) {
    const writes = /** @type {any} */ (event.target)?.matches?.(WRITABLE);
    if (event.code !== CODE || event.repeat || writes || event.ctrlKey || event.metaKey || event.altKey || this.down) {
      return;
    }
    this.down = true;
    this.onTalk(true);
  }
}
