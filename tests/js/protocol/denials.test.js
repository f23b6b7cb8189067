import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { describe, test } from "node:test";

import { newState } from "../../../static/js/drive/features.js";
import { wordOfDenial } from "../../../static/js/protocol/denials.js";
import { awaitsAnswer, newVisit, reduce } from "../../../static/js/protocol/session.js";
import { alertFor } from "../../../static/js/view/hud/alert.js";
import { cardFor } from "../../../static/js/view/hud/card.js";

const TEMPLATE = readFileSync(
  new URL("../../../templates/sessions/_words.html", import.meta.url),
  "utf8",
);
const WORDS = new Set(Array.from(TEMPLATE.matchAll(/data-word="([^"]+)"/g), ([, word]) => word));
/** Everything that a visitor asks the server for, and in which phases. */
const REQUESTS = {
  "session/take": ["taking"],
  "session/observe": ["taking", "queued"],
  "session/leave": ["ended", "lobby"],
  "session/assist": ["driving"],
  "command/action": ["lobby", "queued", "watching", "driving"],
  "audience/hand": ["watching"],
  "audience/mark": ["watching", "driving"],
  "audience/lower": ["watching", "driving"],
};
const ROBOT = { safety: { estop: false, inhibited: null, collision: false } };
const state = (visit, more = {}) => ({
  ...newState(),
  ...more,
  visit: { ...newVisit(), socket: "open", online: true, mayDrive: true, ...visit },
});

describe("a denied request", () => {
  for (const [suffix, phases] of Object.entries(REQUESTS)) {
    for (const phase of phases) {
      for (const reason of ["unavailable", "busy", "rate"]) {
        test(`${suffix} (${reason}) has an alert that is visible on the page: ${phase}`, () => {
          const word = wordOfDenial({ suffix, reason });
          assert.ok(WORDS.has(word), word);
          const before = state({ phase, unsaid: { session: "s1" } }).visit;
          const { visit } = reduce(before, { type: "denied", message: { suffix, reason } });
          const shown = state(visit, { denial: { word, at: 0, until: 8 }, now: 1 });
          assert.equal(alertFor(shown)?.word, word);
          const card = cardFor(shown);
          assert.ok(card === null || card.warning?.word === word);
          assert.notEqual(alertFor({ ...shown, now: 9 })?.word, word);
        });
      }
    }
  }

  test("that no visitor made has no alert", () => {
    for (const suffix of ["command/velocity", "command/heartbeat", "signal", "page/event"]) {
      assert.equal(wordOfDenial({ suffix, reason: "rate" }), "");
    }
    assert.equal(wordOfDenial({ suffix: "command/action", reason: "not_driver" }), "");
  });

  test("for video is repeated while waiting until it is there, or refused", () => {
    const denied = { type: "denied", message: { suffix: "session/observe", reason: "rate" } };
    const waiting = { ...newVisit(), phase: "queued", socket: "open", wanted: "drive" };
    const { visit } = reduce(waiting, denied);
    assert.ok(awaitsAnswer(visit));
    assert.deepEqual(reduce(visit, { type: "no_answer" }).effects, [
      { type: "send", suffix: "session/observe", message: {} },
    ]);
    for (const answer of [
      { type: "session/observing", message: { iceServers: [], sfu: false } },
      { type: "session/refused", message: { reason: "observers_full" } },
    ]) {
      assert.ok(!awaitsAnswer(reduce(visit, answer).visit));
    }
  });

  test("for video is not repeated by a visitor who no longer waits", () => {
    const waiting = {
      ...newVisit(),
      phase: "turn",
      socket: "open",
      wanted: "drive",
      session: "s1",
      observesAgain: true,
    };
    const sent = (visit) =>
      reduce(visit, { type: "no_answer" }).effects.map((effect) => effect.suffix);
    assert.deepEqual(sent(waiting), ["session/observe"]);
    const { visit: started } = reduce(waiting, { type: "start", now: 1 });
    assert.deepEqual(sent(started), ["session/take"]);
    const elsewhere = { reason: "elsewhere", session: "s1", since: 1 };
    const { visit: left } = reduce(waiting, { type: "session/refused", message: elsewhere });
    assert.deepEqual([sent(left), awaitsAnswer(left)], [[], false]);
    const late = { type: "session/observing", message: { iceServers: [], sfu: false }, now: 2 };
    for (const visit of [started, left]) {
      assert.deepEqual(reduce(visit, late), { visit, effects: [] }, "an answer that comes late");
    }
    const driving = { ...waiting, phase: "driving" };
    assert.deepEqual([sent(driving), awaitsAnswer(driving)], [[], false]);
  });

  test("gives way to a later request or answer", () => {
    const denial = { word: "denied.action", at: 100, until: 110 };
    const later = { word: "point.wall", values: {}, at: 103, until: 104 };
    const shown = (more) =>
      alertFor(
        state({ phase: "driving", link: "live" }, { robot: ROBOT, denial, now: 105, ...more }),
      )?.word;
    assert.equal(shown({}), "denied.action");
    for (const at of [99, 103]) {
      const expected = at < denial.at ? "denied.action" : undefined;
      assert.equal(shown({ said: { ...later, at } }), expected, "answered");
      assert.equal(shown({ task: { status: "RUNNING", askedAt: at } }), expected, "sent");
      assert.equal(shown({ release: { id: "r", since: at, refused: false } }), expected);
    }
    assert.equal(shown({ barred: { method: "keyboard", at: 103 } }), "off.keyboard");
  });

  test("gives way to answers and to why the robot does not move, not to others", () => {
    const denial = { word: "denied.action", at: 100, until: 110 };
    const shown = (more, visit = {}) =>
      alertFor(
        state(
          { phase: "driving", link: "live", ...visit },
          { robot: ROBOT, denial, now: 105, ...more },
        ),
      )?.word;
    const said = { word: "point.wall", values: {}, at: 99, until: 108 };
    assert.equal(shown({ said }), "point.wall");
    assert.equal(shown({ stuck: { word: "stuck.contact" } }), "stuck.contact");
    assert.equal(shown({}, { turnEnds: 130 }), "denied.action");
    assert.equal(shown({ roundTrip: 1 }), "denied.action");
    assert.equal(shown({ robot: { ...ROBOT, pose: { localized: false } } }), "denied.action");
  });

  test("to leave is repeated when the server was busy", () => {
    const visit = { ...newVisit(), phase: "ended", socket: "open", unsaid: { session: "s1" } };
    for (const reason of ["unavailable", "busy", "rate"]) {
      const denied = { type: "denied", message: { suffix: "session/leave", reason } };
      assert.deepEqual(reduce(visit, denied).visit.unsaid, { session: "s1" });
    }
  });
});
