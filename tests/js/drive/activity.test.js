import assert from "node:assert/strict";
import { describe, test } from "node:test";

import { watchActivity } from "../../../static/js/drive/activity.js";

class Tone {
  constructor(audio, { frequency }) {
    Object.assign(this, { audio, frequency });
  }
  connect(to) {
    return to;
  }
  start() {
    this.audio.played.push(this.frequency);
  }
  stop() {}
}

class Audio {
  state = "suspended";
  currentTime = 0;
  destination = { connect: () => undefined };
  played = [];
  constructor() {
    Audio.made.push(this);
  }
  async resume() {
    this.state = "running";
  }
}
Audio.made = [];

class Note {
  static permission = "default";
  static shown = [];
  static refuses = false;
  static async requestPermission() {
    Note.permission = "granted";
    return "granted";
  }
  constructor(title, { body }) {
    if (Note.refuses) {
      throw new TypeError("Illegal constructor");
    }
    Note.shown.push([title, body]);
  }
}

const page = { hidden: true, hasFocus: () => false, querySelector: () => null };
Object.assign(globalThis, {
  AudioContext: Audio,
  OscillatorNode: Tone,
  GainNode: class {
    gain = { linearRampToValueAtTime: () => undefined };
    connect = (to) => to;
  },
  Notification: Note,
  document: page,
});
Object.defineProperty(globalThis, "navigator", {
  value: { vibrate: () => true },
  configurable: true,
});
const { askPermission, call, permission, prepare } =
  await import("../../../static/js/waiting/notification.js");

describe("calling a visitor", () => {
  test("makes no sound before a touch, and shows only allowed notifications", async () => {
    await call("It is your turn", "Press Start");
    assert.deepEqual([Audio.made.length, Note.shown], [0, []]);
  });

  test("sounds after a touch, and notifies a visitor who looks elsewhere", async () => {
    prepare();
    assert.equal(await askPermission(), "granted");
    assert.equal(permission(), "granted");
    await call("It is your turn", "Press Start");
    assert.equal(Audio.made.length, 1);
    assert.equal(Audio.made[0].played.length, 2);
    assert.deepEqual(Note.shown, [["It is your turn", "Press Start"]]);
  });

  test("shows no notification on a page in the foreground", async () => {
    Object.assign(page, { hidden: false, hasFocus: () => true });
    await call("It is your turn", "Press Start");
    assert.equal(Note.shown.length, 1);
    Object.assign(page, { hidden: true, hasFocus: () => false });
  });

  test("works in browsers without notifications", async () => {
    Note.refuses = true;
    await call("It is your turn", "Press Start");
    assert.equal(Note.shown.length, 1);
  });
});

describe("signs of activity", () => {
  const begin = () => {
    const [target, signs, now, asked] = [new EventTarget(), [], { at: 100 }, { now: false }];
    watchActivity({
      target,
      clock: () => now.at,
      isAsked: () => asked.now,
      onSign: () => signs.push(now.at),
    });
    return { signs, now, asked, does: (kind) => target.dispatchEvent(new Event(kind)) };
  };

  test("are sent every few seconds and not for every key", () => {
    const { signs, now, does } = begin();
    for (const kind of ["keydown", "keydown", "pointerdown", "wheel", "input"]) {
      does(kind);
      now.at += 1;
    }
    now.at += 15;
    does("keydown");
    assert.deepEqual(signs, [100, 120]);
  });

  test("are sent at once while the visitor is asked", () => {
    const { signs, now, asked, does } = begin();
    does("keydown");
    now.at += 1;
    asked.now = true;
    does("pointerdown");
    assert.deepEqual(signs, [100, 101]);
  });
});
