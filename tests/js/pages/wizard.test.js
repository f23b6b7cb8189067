import assert from "node:assert/strict";
import { test } from "node:test";

import { faultFor } from "../../../static/js/pages/wizard/fault.js";
import { Hand } from "../../../static/js/pages/wizard/hand.js";
import { begin, turned, velocityOf } from "../../../static/js/pages/wizard/moves.js";
import { noticeOfDenied, readPacket } from "../../../static/js/pages/wizard/packets.js";
import { Rejection } from "../../../static/js/protocol/robot_api.js";

const LIMITS = { linear: 0.5, reverse: 0.25, angular: 1 };

test("a drive takes exactly the time of the step", () => {
  const move = begin({ drive: { linear: 0.2, angular: -0.1, seconds: 2 }, turn: null }, 10);
  assert.deepEqual(velocityOf(move, 11.99, LIMITS), { linear: 0.2, angular: -0.1 });
  assert.equal(velocityOf(move, 12, LIMITS), null);
});

test("a turn follows the robot's heading, also across the back, and ends", () => {
  const dt = 0.05;
  for (const angle of [3.14, -3.14, 1, -0.4]) {
    let move = begin({ drive: null, turn: angle }, 0);
    let heading = 2;
    let now = 0;
    move = turned(move, heading);
    for (
      let velocity = velocityOf(move, now, LIMITS);
      velocity;
      velocity = velocityOf(move, now, LIMITS)
    ) {
      assert.ok(Math.abs(velocity.angular) <= LIMITS.angular);
      heading += velocity.angular * dt;
      now += dt;
      move = turned(move, Math.atan2(Math.sin(heading), Math.cos(heading)));
    }
    assert.ok(Math.abs(heading - 2 - angle) < 0.1, `${angle}: ${heading - 2}`);
  }
});

test("a turn without a heading ends after a time", () => {
  const move = begin({ drive: null, turn: 1 }, 0);
  assert.ok(velocityOf(move, 24, LIMITS));
  assert.equal(velocityOf(move, 26, LIMITS), null);
});

test("held keys give a velocity, and a release gives none", () => {
  let changes = 0;
  const hand = new Hand({ onChange: () => (changes += 1) });
  hand.press("backward", "keyboard");
  hand.press("left", "touch");
  assert.deepEqual(hand.velocity(LIMITS), { linear: -0.15, angular: 0.6, method: "touch" });
  hand.letGo();
  hand.letGo();
  assert.equal(hand.velocity(LIMITS).angular, 0);
  assert.equal(changes, 3);
  assert.equal(Hand.directionOf("forward"), "forward");
  assert.equal(Hand.directionOf("talk"), null);
});

test("the operator sees that a request failed, but not that one velocity was dropped", () => {
  const { suffix, message } = readPacket(
    'denied\n{"suffix": "wizard/take", "reason": "unavailable"}',
  );
  assert.equal(suffix, "denied");
  assert.equal(noticeOfDenied(message), "unavailable");
  assert.equal(noticeOfDenied({ suffix: "wizard/step", reason: "rate" }), "unavailable");
  assert.equal(noticeOfDenied({ suffix: "command/action", reason: "unavailable" }), "unavailable");
  for (const suffix of ["command/velocity", "command/heartbeat", "wizard/reached", "signal"]) {
    assert.equal(noticeOfDenied({ suffix, reason: "rate" }), null);
  }
});

test("the operator sees at once that the robot has stopped when the broker fails", () => {
  const word = (fault, changes = {}) =>
    faultFor(
      { granted: { epoch: 1 }, connected: true, silent: false, faults: [fault], ...changes },
      100,
    )?.word;
  const broker = { part: "broker", then: "stops", at: 107 };
  assert.equal(word(broker), "fault.broker.stopped");
  assert.equal(word({ ...broker, part: "database" }), "fault.database.stops");
  assert.equal(word(broker, { granted: null }), "fault.broker.watched");
  assert.equal(word(broker, { connected: false }), undefined);
  assert.equal(word(broker, { silent: true }), undefined);
});

test("the operator sees that the robot is silent, whatever the video shows", () => {
  for (const then of ["waits", "stopped"]) {
    for (const granted of [null, { epoch: 1 }]) {
      const faults = [{ part: "robot", then, at: null }];
      const shown = faultFor({ granted, connected: true, silent: false, faults }, 100);
      assert.equal(shown?.word, "fault.robot.stopped");
    }
  }
});

test("a packet of the server has its defaults, and an unknown one is refused", () => {
  const step = { key: "b", title: "B", drive: { seconds: 2 } };
  const stage = { key: "a", title: "A", steps: [step] };
  const { message } = readPacket(
    `wizard/session\n${JSON.stringify({ session: "s", script: { stages: [stage] } })}`,
  );
  assert.deepEqual(message.script.stages[0].steps[0].drive, { linear: 0, angular: 0, seconds: 2 });
  assert.equal(message.script.byHand, true);
  assert.equal(message.operator, "");
  assert.throws(() => readPacket("wizard/other\n{}"), Rejection);
});
