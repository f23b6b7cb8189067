/**
 * Push to talk: the visitor is heard while T is down. T lies apart from the keys that drive.
 */

const CODE = "KeyT";

export class TalkKey {
  /**
   * @param {object} options
   * @param {import("../input/key_dispatcher.js").KeyDispatcher} options.keys
   * @param {(down: boolean) => void} options.onTalk
   */
  constructor({ keys, onTalk }) {
    this.onTalk = onTalk;
    this.pressed = false;
    keys.add(this);
  }

  letGo() {
    if (this.pressed) {
      this.pressed = false;
      this.onTalk(false);
    }
  }

  /** @param {KeyboardEvent} event */
  down({ code, repeat }) {
    if (code === CODE && !repeat && !this.pressed) {
      this.pressed = true;
      this.onTalk(true);
    }
  }

  /** @param {KeyboardEvent} event */
  up({ code }) {
    if (code === CODE) {
      this.letGo();
    }
  }
}
