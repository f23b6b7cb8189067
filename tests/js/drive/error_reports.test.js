import assert from "node:assert/strict";
import { test } from "node:test";

import { ErrorReports } from "../../../static/js/drive/error_reports.js";

const reporter = (isOnline = () => true) => {
  const sent = [];
  const errors = new ErrorReports((data) => isOnline() && Boolean(sent.push(data)));
  return { errors, sent };
};

test("an error is reported once, with its place in our scripts", () => {
  const { errors, sent } = reporter();
  const error = new TypeError("x is undefined");
  error.stack = "TypeError: x\n at a (https://h/static/js/view/hud/card.1234567890ab.js:12:3)";
  errors.note(error);
  errors.poll(100);
  errors.poll(200);
  assert.deepEqual(sent, [
    { error: "TypeError: x is undefined", at: "view/hud/card.js:12", times: 1 },
  ]);
});

test("an error that repeats is reported again after ten times as many", () => {
  const { errors, sent } = reporter();
  for (let now = 0; now < 1000; now += 1) {
    errors.note(new Error("again"), "here");
    errors.poll(now);
  }
  assert.deepEqual(
    sent.map(({ times }) => times),
    [1, 10, 100, 1000],
  );
});

test("different errors are reported five seconds apart, and not without end", () => {
  const { errors, sent } = reporter();
  for (let n = 0; n < 50; n += 1) {
    errors.note(`error ${n}`, "here");
  }
  for (let now = 0; now < 10; now += 0.1) {
    errors.poll(now);
  }
  assert.equal(sent.length, 2);
  for (let now = 10; now < 1000; now += 1) {
    errors.poll(now);
  }
  assert.equal(sent.length, 20);
});

test("an error is reported once there is a session and a connection", () => {
  let isOnline = false;
  const { errors, sent } = reporter(() => isOnline);
  errors.note(new Error("early"), "here");
  errors.poll(1);
  assert.equal(sent.length, 0);
  isOnline = true;
  errors.poll(2);
  assert.equal(sent.length, 1);
});

test("a long text is cut to what the server accepts", () => {
  const { errors, sent } = reporter();
  errors.note("x".repeat(500), "here");
  errors.poll(1);
  assert.equal(sent[0].error.length, 200);
});
