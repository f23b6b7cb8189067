import assert from "node:assert/strict";
import { describe, test } from "node:test";

import { Receipts, newFate } from "../../../static/js/pages/screen/receipts.js";
import { createVoice } from "../../../static/js/pages/screen/speech.js";

describe("receipts of messages", () => {
  const fateOf = (...steps) => {
    const told = [];
    const fate = newFate((state) => told.push(state));
    for (const [step, value] of steps) {
      fate[step](value);
    }
    return told;
  };

  test("a visible message is shown, and one read to its end is spoken", () => {
    assert.deepEqual(fateOf(), []);
    assert.deepEqual(fateOf(["seen"]), ["shown"]);
    assert.deepEqual(fateOf(["seen"], ["spoken", true]), ["shown", "spoken"]);
    assert.deepEqual(fateOf(["seen"], ["spoken", false]), ["shown", "not_spoken"]);
  });

  test("a message that was not visible does not count as shown when its voice fails", () => {
    assert.deepEqual(fateOf(["spoken", false]), []);
    assert.deepEqual(fateOf(["spoken", false], ["seen"]), ["not_spoken"]);
    assert.deepEqual(fateOf(["spoken", true]), ["spoken"]);
  });
});

describe("receipts", () => {
  const world = () => {
    const sent = [];
    const receipts = new Receipts((fields, id) => sent.push([id, fields]));
    return { sent, receipts };
  };
  const answer = (actionId, status, reason = "") => ({ actionId, status, reason });

  test("are repeated under the same id until the robot answers", () => {
    const { sent, receipts } = world();
    receipts.say("a1", "shown", 100);
    receipts.tick(101);
    receipts.tick(102.5);
    receipts.tick(105);
    assert.equal(sent.length, 3);
    assert.equal(new Set(sent.map(([id]) => id)).size, 1);
    receipts.answered(answer(sent[0][0], "FAILED", "stale"));
    receipts.tick(108);
    assert.equal(sent.length, 4);
    receipts.answered(answer(sent[0][0], "FINISHED"));
    receipts.tick(120);
    assert.equal(sent.length, 4);
  });

  test("end when the robot lacks the message, after a minute, and with the session", () => {
    const { sent, receipts } = world();
    receipts.say("a1", "shown", 100);
    receipts.answered(answer(sent[0][0], "FAILED", "unknown_words"));
    receipts.say("a2", "shown", 100);
    receipts.tick(170);
    receipts.say("a3", "shown", 170);
    assert.equal(receipts.known.get("a3"), "shown");
    receipts.forget();
    receipts.tick(180);
    assert.deepEqual(
      sent.map(([, { target }]) => target),
      ["a1", "a2", "a3"],
    );
    assert.equal(receipts.known.size, 0);
  });
});

describe("the display's voice", () => {
  const world = () => {
    const spoken = [];
    const timers = new Set();
    const ends = [];
    let cancelled = 0;
    const voice = createVoice({
      synthesis: { speak: (one) => spoken.push(one), cancel: () => (cancelled += 1) },
      Utterance: class {
        constructor(text) {
          this.text = text;
        }
      },
      later: (call) => {
        timers.add(call);
        return call;
      },
      never: (timer) => timers.delete(timer),
    });
    const say = (text, volume = 1) =>
      voice.speak(text, "en", volume, (done) => ends.push([text, done]));
    const fire = () => {
      const [timer] = timers;
      timers.delete(timer);
      timer();
    };
    return { voice, say, spoken, ends, fire, timers, cancelled: () => cancelled };
  };

  test("speaks one message after another, and reports the end of each", () => {
    const { say, spoken, ends, timers } = world();
    say("one");
    say("two");
    assert.deepEqual(
      spoken.map(({ text }) => text),
      ["one"],
    );
    spoken[0].onstart();
    assert.deepEqual(ends, []);
    spoken[0].onend();
    assert.deepEqual([ends, spoken[1].text], [[["one", true]], "two"]);
    spoken[1].onerror();
    spoken[1].onend();
    assert.deepEqual(ends, [
      ["one", true],
      ["two", false],
    ]);
    assert.equal(timers.size, 0);
  });

  test("skips a message that does not start or end in time", () => {
    const { say, spoken, ends, fire, cancelled } = world();
    say("never begins");
    say("never ends");
    fire();
    spoken[1].onstart();
    fire();
    assert.deepEqual(ends, [
      ["never begins", false],
      ["never ends", false],
    ]);
    assert.equal(cancelled(), 2);
  });

  test("is silent after it was hushed", () => {
    const { voice, say, spoken, ends } = world();
    say("one");
    say("two");
    voice.hush();
    spoken[0].onend();
    assert.deepEqual(ends, [
      ["one", false],
      ["two", false],
    ]);
    say("three");
    assert.deepEqual(
      spoken.map(({ text }) => text),
      ["one", "three"],
    );
  });

  test("does not count as heard at volume 0, or without speech", () => {
    const { say, ends, spoken } = world();
    say("softly", 0);
    assert.deepEqual([ends, spoken], [[["softly", false]], []]);
    let done = null;
    createVoice({ synthesis: undefined, Utterance: undefined }).speak("Hola", "es", 1, (it) => {
      done = it;
    });
    assert.equal(done, false);
  });
});
