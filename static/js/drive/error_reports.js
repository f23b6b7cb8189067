/**
 * Reports errors of the page's scripts to the server, for the record of the session: each when it
 * first occurs, and again after ten times as many; at most one every few seconds. Without a session
 * or a connection they are reported later. Pure: connection.js listens for them.
 */

const PERIOD = 5; // s between two reports
const MOST = 20; // different errors of one page
const LONGEST = 200; // characters: sessions/protocol.py Detail

export class ErrorReports {
  /** @param {(data: PageEventData) => boolean} send whether it was handed to the network */
  constructor(send) {
    this.send = send;
    this.sentAt = -Infinity;
    /** @type {Map<string, {at: string, times: number, reported: number}>} by their texts */
    this.errors = new Map();
  }

  /** @param {any} error @param {string} [place] where it occurred */
  note(error, place = placeIn(error?.stack ?? "")) {
    const text = String(error).slice(0, LONGEST);
    const known = this.errors.get(text);
    if (known) {
      known.times += 1;
    } else if (this.errors.size < MOST) {
      this.errors.set(text, { at: place, times: 1, reported: 0 });
    }
  }

  /** Reports an error, if it is time. @param {number} now s */
  poll(now) {
    const next = [...this.errors].find(([, { times, reported }]) => times >= 10 * reported);
    if (!next || now - this.sentAt < PERIOD) {
      return;
    }
    const [error, counted] = next;
    if (this.send({ error, at: counted.at, times: counted.times })) {
      counted.reported = counted.times;
      this.sentAt = now;
    }
  }
}

/** The first place of our scripts in a stack, such as `drive/page.js:12`. @param {string} stack */
const placeIn = (stack) => {
  const [, file = "", line = ""] = /static\/js\/([\w/]+)[\w.]*\.js[^:\s]*:(\d+)/.exec(stack) ?? [];
  return file && `${file}.js:${line}`;
};
