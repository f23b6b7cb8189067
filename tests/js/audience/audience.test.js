import assert from "node:assert/strict";
import { describe, test } from "node:test";

import { WaitingNews, countOf, handsText, isOffered } from "../../../static/js/audience/panel.js";
import { createWords } from "../../../static/js/lib/words.js";

const question = (state) => ({ id: state, text: "Why?", state, who: "", own: false });
const audience = (changes = {}) => ({
  open: true,
  moderates: false,
  raised: false,
  hands: 0,
  names: [],
  questions: [],
  ...changes,
});

describe("the audience on the drive page", () => {
  test("viewers have it, and the driver once there are viewers", () => {
    const state = (phase, observers, changes = {}) => ({
      visit: { phase, link: "live" },
      room: { observers },
      audience: audience(changes),
    });
    assert.ok(isOffered(state("watching", 1)));
    assert.ok(!isOffered(state("watching", 1, { open: false })));
    assert.ok(!isOffered(state("lobby", 1)));
    assert.ok(!isOffered(state("driving", 0)));
    assert.ok(isOffered(state("driving", 1)));
    assert.ok(isOffered(state("driving", 0, { questions: [question("waiting")] })));
  });

  test("counts open hands and questions for the moderator only", () => {
    const waits = {
      hands: 2,
      questions: [question("waiting"), question("answering"), question("declined")],
    };
    assert.equal(countOf(audience({ ...waits, moderates: true })), 3);
    assert.equal(countOf(audience(waits)), 0);
  });

  test("announces when more wait, but not each of many", () => {
    const news = new WaitingNews();
    const heard = [
      [0, 0],
      [1, 1],
      [2, 2], // another at once
      [3, 10.9],
      [3, 11], // both together
      [3, 30],
      [1, 31], // two have been answered
      [1, 50],
      [2, 51],
    ].map(([count, now]) => news.hear(count, now));
    assert.deepEqual(heard, [false, true, false, false, true, false, false, false, true]);
  });

  test("names the viewers with a raised hand, and the number of others", () => {
    const words = createWords(
      new Map([
        ["audience.hands.one", "1 hand: {names}"],
        ["audience.hands.other", "{n} hands: {names}"],
        ["audience.more", "{n} more"],
        ["audience.no_hands", "none"],
        ["name.(visitor)", "Guest"],
      ]),
      "en",
    );
    assert.equal(handsText({ hands: 0, names: [] }, words, "en"), "none");
    assert.equal(handsText({ hands: 1, names: ["Ada"] }, words, "en"), "1 hand: Ada");
    assert.equal(
      handsText({ hands: 5, names: ["Ada", "Bob"] }, words, "en"),
      "5 hands: Ada, Bob, and 3 more",
    );
    assert.equal(
      handsText({ hands: 2, names: ["Ada", "(visitor)"] }, words, "en"),
      "2 hands: Ada and Guest",
    );
  });
});
