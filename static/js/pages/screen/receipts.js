/**
 * Receipts for messages on this display: that they were visible, and whether they were read aloud
 * to the end. A receipt is repeated until the robot has it.
 */

import { freshId } from "../../lib/ids.js";

const AGAIN = 2; // s between two tries
const PATIENCE = 60; // s; an older receipt is dropped

/** @typedef {"shown" | "spoken" | "not_spoken"} WordsState */

export class Receipts {
  /** @param {(fields: {target: string, state: WordsState}, actionId: string) => unknown} send */
  constructor(send) {
    this.send = send;
    /**
     * @type {Map<string, {fields: {target: string, state: WordsState}, since: number,
     *   sentAt: number}>} by their ids
     */
    this.pending = new Map();
    /** @type {Map<string, WordsState>} of this session, by the ids of messages */
    this.known = new Map();
  }

  /** @param {string} target a message's id @param {WordsState} state @param {number} now s */
  say(target, state, now) {
    const id = freshId("seen-");
    this.known.set(target, state);
    this.pending.set(id, { fields: { target, state }, since: now, sentAt: now });
    this.send({ target, state }, id);
  }

  /**
   * The robot's answer; a receipt whose time it refuses is repeated.
   * @param {{actionId: string, status: string, reason: string}} answer
   */
  answered({ actionId, status, reason }) {
    const isRefused = status === "FAILED" && reason !== "stale" && reason !== "future";
    if (status === "FINISHED" || isRefused) {
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
 * The receipts of a message that is seen and spoken. One that was not visible does not count as
 * shown because its voice failed.
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
 * Calls once an element has been visible, on a visible page.
 * @param {Element} element @param {() => void} onSeen
 */
export const whenSeen = (element, onSeen) => {
  const observer = new IntersectionObserver((entries) => {
    if (!entries.some(({ isIntersecting }) => isIntersecting)) {
      return;
    }
    observer.disconnect();
    const again = () => element.isConnected && observer.observe(element);
    if (document.visibilityState === "visible") {
      onSeen();
    } else {
      document.addEventListener("visibilitychange", again, { once: true });
    }
  });
  observer.observe(element);
};
