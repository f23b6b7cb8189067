/**
 * Changes on their way to the server, in order. Each is kept in the browser until the server has
 * it, so that a reload, a closed tab or a lost network loses nothing; what is sent twice is stored
 * once, because each change has an id.
 */

/** @typedef {import("./events.js").Edit} Edit */
/** @typedef {"saved" | "saving" | "waiting" | "refused" | "signed_out"} SaveState */
/** @typedef {{status: number, body: any}} Answer */

const AT_ONCE = 200;
const SHORTEST_S = 1;
const LONGEST_S = 30;

export class SaveQueue {
  /**
   * @param {object} options @param {Storage | null} options.storage
   * @param {string} options.key begins the names under which this coder's changes of this session
   *   are kept
   * @param {(edits: Edit[]) => Promise<Answer>} options.send rejects where there is no network
   * @param {(state: SaveState) => void} options.onState
   * @param {(answer: any, sent: Edit[]) => void} options.onAnswer what the server has now
   * @param {(seconds: number, then: () => void) => void} [options.later]
   * @param {() => number} [options.now] ms
   */
  constructor({
    storage,
    key,
    send,
    onState,
    onAnswer,
    later = (seconds, then) => setTimeout(then, seconds * 1000),
    now = Date.now,
  }) {
    this.storage = storage;
    this.key = key;
    this.send = send;
    this.onState = onState;
    this.onAnswer = onAnswer;
    this.later = later;
    this.now = now;
    this.count = 0;
    this.wait = SHORTEST_S;
    this.isSending = false;
    this.isWaiting = false;
    /** @type {((isSaved: boolean) => void)[]} */
    this.asking = [];
    /** @type {{name: string, edit: Edit}[]} */
    this.entries = this.#kept();
  }

  /** @returns {Edit[]} */
  get pending() {
    return this.entries.map(({ edit }) => edit);
  }

  /** @param {Edit[]} edits */
  add(edits) {
    for (const edit of edits) {
      this.count += 1;
      const at = String(this.now()).padStart(15, "0");
      const name = `${this.key}:${at}:${String(this.count).padStart(6, "0")}:${edit.id}`;
      this.entries.push({ name, edit });
      attempt(() => this.storage?.setItem(name, JSON.stringify(edit)));
    }
    this.flush();
  }

  /** Send what there is, and tell whether the server has all of it. @returns {Promise<boolean>} */
  settled() {
    if (!this.entries.length) {
      return Promise.resolve(true);
    }
    const answer = new Promise((resolve) => this.asking.push(resolve));
    this.flush();
    return answer;
  }

  /** Send what there is; call it again whenever that may help. */
  async flush() {
    if (this.isSending || !this.entries.length) {
      return;
    }
    this.isSending = true;
    this.onState("saving");
    const sent = this.entries.slice(0, AT_ONCE);
    const answer = await this.send(sent.map(({ edit }) => edit)).catch(() => ({
      status: 0,
      body: null,
    }));
    this.isSending = false;
    this.#take(answer, sent);
  }

  /** @param {Answer} answer @param {{name: string, edit: Edit}[]} sent */
  #take({ status, body }, sent) {
    if (status === 200) {
      this.wait = SHORTEST_S;
      this.#drop(sent);
      this.onAnswer(
        body,
        sent.map(({ edit }) => edit),
      );
      this.onState(this.entries.length ? "saving" : "saved");
      this.flush();
    } else if (status === 409 || status === 400) {
      this.onAnswer(body ?? {}, []);
      this.onState("refused");
    } else if ([302, 401, 403, 404].includes(status)) {
      this.onState("signed_out");
    } else {
      this.#again();
    }
    if (status !== 200 || !this.entries.length) {
      this.asking.splice(0).forEach((resolve) => resolve(status === 200));
    }
  }

  #again() {
    this.onState("waiting");
    if (!this.isWaiting) {
      this.isWaiting = true;
      this.later(this.wait, () => {
        this.isWaiting = false;
        this.flush();
      });
      this.wait = Math.min(2 * this.wait, LONGEST_S);
    }
  }

  /** @param {{name: string}[]} entries */
  #drop(entries) {
    const gone = new Set(entries.map(({ name }) => name));
    this.entries = this.entries.filter(({ name }) => !gone.has(name));
    gone.forEach((name) => attempt(() => this.storage?.removeItem(name)));
  }

  /** @returns {{name: string, edit: Edit}[]} */
  #kept() {
    const names = attempt(() => Object.keys(this.storage ?? {})) ?? [];
    return names
      .filter((name) => name.startsWith(`${this.key}:`))
      .sort()
      .flatMap((name) => {
        const edit = attempt(() => JSON.parse(this.storage?.getItem(name) ?? "null"));
        return edit && typeof edit.id === "string" ? [{ name, edit }] : [];
      });
  }
}

/**
 * Storage may be forbidden, full or spoiled; then changes live as long as the page.
 * @template T
 * @param {() => T} what @returns {T | undefined}
 */
const attempt = (what) => {
  try {
    return what();
  } catch (error) {
    if (error instanceof SyntaxError || error instanceof DOMException) {
      return undefined;
    }
    throw error;
  }
};
