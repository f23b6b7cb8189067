/**
 * Tells the visitor what became of their words on this display: that they were visible, and whether
 * they were read aloud to the end. What is said here is said again until the robot has it, for the
 * connection may be away just then.
 */

import { freshId } from "../../lib/ids.js";

const AGAIN = 2; // s between two tries
const PATIENCE = 60; // s; after that it is of no use

/** @typedef {"shown" | "spoken" | "not_spoken"} WordsState */

export class Receipts {
  /** @param {(fields: {target: string, state: WordsState}, actionId: string) => unknown} send */
  constructor(send) {
    this.send = send;
    /**
     * @type {Map<string, {fields: {target: string, state: WordsState}, since: number,
     *   sentAt: number}>} by the id of what is said
     */
    this.pending = new Map();
    /** @type {Map<string, WordsState>} what is known of the words of this session, by their id */
    this.known = new Map();
  }

  /**
   * @param {string} target the id of the words
   * @param {WordsState} state
   * @param {number} now Unix seconds
   */
  say(target, state, now) {
    const id = freshId("seen-");
    this.known.set(target, state);
    this.pending.set(id, { fields: { target, state }, since: now, sentAt: now });
    this.send({ target, state }, id);
  }

  /**
   * The robot's answer; what came too late or too early is said again.
   * @param {{actionId: string, status: string, reason: string}} answer
   */
  answered({ actionId, status, reason }) {
    if (
      status === "FINISHED" ||
      (status === "FAILED" && reason !== "stale" && reason !== "future")
    ) {
      this.pending.delete(actionId);
    }
  }

  /** @param {number} now */
  tick(now) {
    for (const [id, one] of this.pending) {
      if (now - one.since > PATIENCE) {
        this.pending.delete(id);
      } else if (now - one.sentAt > AGAIN) {
        one.sentAt = now;
        this.send(one.fields, id);
      }
    }
  }

  forget() {
    this.pending.clear();
    this.known.clear();
  }
}

/**
 * From whether words were seen and spoken to what the visitor is told. Words that nobody could see
 * are not said to be shown because their voice failed.
 * @param {(state: WordsState) => void} say
 */
export const newFate = (say) => {
  let seen = false;
  let silent = false;
  return {
    seen: () => {
      seen = true;
      say(silent ? "not_spoken" : "shown");
    },
    /** @param {boolean} done whether they were read aloud to the end */
    spoken: (done) => {
      silent = !done;
      if (done || seen) {
        say(done ? "spoken" : "not_spoken");
      }
    },
  };
};

/**
 * Calls back once an element has really been on the screen: not while the page is hidden, nor while
 * the element is out of sight.
 * @param {Element} element @param {() => void} onSeen
 */
export const whenSeen = (element, onSeen) => {
  const observer = new IntersectionObserver((entries) => {
    if (!entries.some(({ isIntersecting }) => isIntersecting)) {
      return;
    }
    observer.disconnect();
    if (document.visibilityState === "visible") {
      onSeen();
    } else {
      document.addEventListener("visibilitychange", () => observer.observe(element), {
        once: true,
      });
    }
  });
  observer.observe(element);
};
