import assert from "node:assert/strict";
import { test } from "node:test";

import { ask } from "../../../static/js/protocol/robot_action.js";
import {
  DOUBT,
  lineFor,
  newDelivery,
  onAnswer,
  onReceipt,
  onTime,
  onWords,
  retry,
} from "../../../static/js/presence/delivery.js";

const said = (fields = {}) =>
  newDelivery(ask({ type: "say", text: "Hello", aloud: false, ...fields }, "say-1", 100));
const finished = { actionId: "say-1", status: "FINISHED", type: "say", reason: "", result: {} };
const refused = (reason) => ({ ...finished, status: "FAILED", reason });
const withReceipts = { receipts: true };

/** Let time pass, tick by tick, and count what is sent again. */
const pass = (delivery, from, to) => {
  let sent = 0;
  for (let now = from; now <= to; now += 0.1) {
    const next = onTime(delivery, now);
    delivery = next.delivery;
    sent += next.send ? 1 : 0;
  }
  return { delivery, sent };
};

test("a message is sent when the robot has it, shown and read when displayed", () => {
  let delivery = said({ aloud: true });
  const lines = [lineFor(delivery, 1, 100)];
  for (const change of [
    (one) => onWords(one, withReceipts, 100.1),
    (one) => onAnswer(one, finished, 100.2),
    (one) => onReceipt(one, "shown", 100.3),
    (one) => onReceipt(one, "spoken", 103),
  ]) {
    delivery = change(delivery);
    lines.push(lineFor(delivery, 1, 103));
  }
  assert.deepEqual(lines, ["said.sending", "said.sent", "said.sent", "said.shown", "said.spoken"]);
});

test("a receipt of one display is not revoked by another", () => {
  const delivery = onReceipt(said(), "spoken", 101);
  for (const state of ["shown", "not_spoken", "spoken"]) {
    assert.equal(onReceipt(delivery, state, 102).stage, "spoken");
  }
  assert.equal(onReceipt(onReceipt(said(), "not_spoken", 101), "spoken", 102).stage, "spoken");
});

test("without an answer it is repeated for three seconds, and has then failed", () => {
  const { delivery, sent } = pass(said(), 100, 110);
  assert.equal(delivery.stage, "failed");
  assert.ok(sent >= 3 && sent <= 5, `${sent}`);
  assert.equal(lineFor(delivery, 1, 110), "said.failed");
});

test("a refusal at the very start is no failure, a later one is", () => {
  assert.equal(onAnswer(said(), refused("clock_unknown"), 100.5).stage, "sending");
  assert.equal(onAnswer(said(), refused("not_allowed"), 100.5).stage, "failed");
});

test("a late answer corrects the state", () => {
  const { delivery } = pass(said(), 100, 110);
  assert.equal(onAnswer(delivery, finished, 110).stage, "sent");
  assert.equal(onWords(delivery, withReceipts, 110).stage, "sent");
  assert.equal(onReceipt(delivery, "shown", 110).stage, "shown");
});

test("a failed message is sent again under the same id", () => {
  const { delivery } = pass(said({ aloud: true }), 100, 110);
  const again = retry(delivery, 120);
  assert.deepEqual(
    [again.stage, again.action.id, again.action.fields, again.action.status],
    ["sending", "say-1", { text: "Hello", aloud: true }, "ASKED"],
  );
  assert.equal(onAnswer(again, finished, 120.5).stage, "sent");
});

test("a robot without receipts is never asked for any", () => {
  const { delivery, sent } = pass(onAnswer(said(), finished, 100), 100, 300);
  assert.deepEqual([delivery.stage, sent], ["sent", 0]);
  assert.equal(lineFor(delivery, 0, 300), "said.sent");
});

test("a lost receipt is requested a few times, and its absence is explained", () => {
  const { delivery, sent } = pass(onWords(said(), withReceipts, 100), 100, 300);
  assert.equal(sent, 3);
  assert.equal(lineFor(delivery, 1, 100 + DOUBT - 1), "said.sent");
  assert.equal(lineFor(delivery, 1, 300), "said.unconfirmed");
  assert.equal(lineFor(delivery, 0, 300), "said.no_screen");
  assert.equal(lineFor(onReceipt(delivery, "shown", 301), 1, 301), "said.shown");
});

test("only a message that is read aloud is asked about once it was shown", () => {
  const shown = (fields) => onReceipt(onWords(said(fields), withReceipts, 100), "shown", 101);
  assert.equal(pass(shown({}), 101, 300).sent, 0);
  assert.equal(pass(shown({ aloud: true }), 101, 300).sent, 3);
});
