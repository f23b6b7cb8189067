/** Push to talk: the microphone is on while the key is down. */

export class PushToTalk {
  /** @param {(down: boolean) => void} onTalk */
  constructor(onTalk) {
    this.onTalk = onTalk;
    this.pressed = false;
  }

  letGo() {
    if (this.pressed) {
      this.pressed = false;
      this.onTalk(false);
    }
  }

  /** @param {{repeat: boolean}} event */
  down({ repeat }) {
    if (!repeat && !this.pressed) {
      this.pressed = true;
      this.onTalk(true);
    }
  }

  up() {
    this.letGo();
  }
}
