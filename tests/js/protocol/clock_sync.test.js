import assert from "node:assert/strict";
import { test } from "node:test";

import { ClockSync } from "../../../static/js/protocol/clock_sync.js";
import { judge } from "../../../static/js/protocol/link_health.js";

const OFFSET = 7; // the robot's clock is seven seconds ahead

/** A robot that answers a beat: `there` seconds on the way, `pause` thinking, `back` on the way. */
const exchange = (
  clockSync,
  way,
  at,
  { there = 0.01, pause = 0.05, back = 0.01, answerOn = way } = {},
) => {
  const beat = clockSync.beat(way, at);
  const received = at + there + OFFSET;
  const now = at + there + pause + back;
  clockSync.heard(
    answerOn,
    {
      n: 1,
      stamp: received + pause,
      echoes: [{ peer: "me", n: beat.n, stamp: beat.stamp, received }],
    },
    "me",
    now,
  );
  return now;
};

test("the offset of the robot's clock is found whatever the robot's delay", () => {
  const clockSync = new ClockSync();
  exchange(clockSync, "datachannel", 100, { pause: 0.15 });
  assert.ok(Math.abs(clockSync.offset - OFFSET) < 1e-9);
  assert.ok(Math.abs(clockSync.roundTrip("datachannel") - 0.02) < 1e-9);
});

test("a round trip is known after enough samples", () => {
  const clockSync = new ClockSync();
  for (let i = 0; i < 5; i += 1) {
    assert.equal(clockSync.roundTrip("datachannel", 5), null);
    exchange(clockSync, "datachannel", 100 + i);
  }
  assert.ok(Math.abs(clockSync.roundTrip("datachannel", 5) - 0.02) < 1e-9);
});

test("a round trip to a disconnected robot is soon unknown", () => {
  const clockSync = new ClockSync();
  const now = exchange(clockSync, "datachannel", 100);
  assert.ok(Math.abs(clockSync.roundTripNow("datachannel", now + 2) - 0.02) < 1e-9);
  assert.equal(clockSync.roundTripNow("datachannel", now + 2, 5), null);
  assert.equal(clockSync.roundTripNow("datachannel", now + 4), null);
  assert.equal(clockSync.roundTripNow("mqtt", now), null);
});

test("the shortest round trip of the last ten counts", () => {
  const clockSync = new ClockSync();
  exchange(clockSync, "mqtt", 100, { there: 0.4, back: 0.01 });
  exchange(clockSync, "mqtt", 101, { there: 0.004, back: 0.004 });
  exchange(clockSync, "mqtt", 102, { there: 0.01, back: 0.5 });
  assert.ok(Math.abs(clockSync.offset - OFFSET) < 1e-9);
  for (let i = 0; i < 10; i += 1) {
    exchange(clockSync, "mqtt", 110 + i, { there: 0.3, back: 0.1 });
  }
  assert.ok(Math.abs(clockSync.offset - OFFSET - 0.1) < 1e-9);
});

test("a transport is fresh for half a second after an echo of a new heartbeat", () => {
  const clockSync = new ClockSync();
  const now = exchange(clockSync, "datachannel", 100);
  assert.equal(clockSync.isFresh("datachannel", now + 0.49), true);
  assert.equal(clockSync.isFresh("datachannel", now + 0.51), false);
  assert.equal(clockSync.isFresh("mqtt", now), false);
});

test("an echo counts for the data channel on either transport, but is no round trip", () => {
  const clockSync = new ClockSync();
  const now = exchange(clockSync, "datachannel", 100, { answerOn: "mqtt" });
  assert.equal(clockSync.isFresh("datachannel", now), true);
  assert.equal(clockSync.roundTrip("datachannel"), null);
  assert.notEqual(clockSync.offset, null);
});

test("the same echo again proves nothing", () => {
  const clockSync = new ClockSync();
  const beat = clockSync.beat("datachannel", 100);
  const answer = {
    n: 1,
    stamp: 100.05 + OFFSET,
    echoes: [{ peer: "me", n: beat.n, stamp: 100, received: 100.01 + OFFSET }],
  };
  clockSync.heard("datachannel", answer, "me", 100.06);
  clockSync.heard("datachannel", answer, "me", 100.56);
  assert.equal(clockSync.isFresh("datachannel", 100.57), false);
  assert.equal(clockSync.samples.length, 1);
});

test("an echo of another peer's heartbeat, or of one that was never sent, is ignored", () => {
  const clockSync = new ClockSync();
  clockSync.beat("datachannel", 100);
  clockSync.heard(
    "datachannel",
    { n: 1, stamp: 107, echoes: [{ peer: "other", n: 0, stamp: 100, received: 107 }] },
    "me",
    100.1,
  );
  clockSync.heard(
    "datachannel",
    { n: 2, stamp: 107, echoes: [{ peer: "me", n: 4000, stamp: 100, received: 107 }] },
    "me",
    100.1,
  );
  assert.equal(clockSync.offset, null);
});

test("an echo from the future gives no sample", () => {
  const clockSync = new ClockSync();
  const beat = clockSync.beat("datachannel", 100);
  clockSync.heard(
    "datachannel",
    { n: 1, stamp: 120, echoes: [{ peer: "me", n: beat.n, stamp: 100, received: 107 }] },
    "me",
    100.1,
  );
  assert.equal(clockSync.offset, null);
});

test("a heartbeat echoes the robot's last one, and has the age of the frame", () => {
  const clockSync = new ClockSync();
  assert.equal(clockSync.beat("mqtt", 99).echo, undefined);
  clockSync.heard("mqtt", { n: 41, stamp: 107, echoes: [] }, "me", 100);
  const beat = clockSync.beat("mqtt", 100.1, 0.06);
  assert.deepEqual(beat.echo, { peer: "robot", n: 41, stamp: 107, received: 100 });
  assert.equal(beat.frameAge, 0.06);
});

test("a new data channel starts without echoes, and continues the numbers", () => {
  const clockSync = new ClockSync();
  const now = exchange(clockSync, "datachannel", 100);
  clockSync.reset("datachannel");
  assert.equal(clockSync.isFresh("datachannel", now), false);
  assert.equal(clockSync.silence("datachannel", now), Infinity);
  assert.equal(clockSync.beat("datachannel", 101).n, 2);
});

const LINK = { state: "connected", offeredAt: 10, answeredAt: 10.2, openedAt: 10.5, heardAt: 20 };

test("a link is live while heartbeats arrive on its data channel", () => {
  assert.equal(judge(LINK, 21.4), "live");
  assert.equal(judge(LINK, 21.6), "silent");
});

test("a link is closed when it fails, is not answered, does not connect, or is silent", () => {
  assert.equal(judge({ ...LINK, state: "failed" }, 20.1), "failed");
  assert.equal(
    judge({ ...LINK, answeredAt: null, openedAt: null, heardAt: -Infinity }, 14.9),
    "waiting",
  );
  assert.equal(
    judge({ ...LINK, answeredAt: null, openedAt: null, heardAt: -Infinity }, 15.1),
    "no_answer",
  );
  assert.equal(judge({ ...LINK, openedAt: null, heardAt: -Infinity }, 19.9), "waiting");
  assert.equal(judge({ ...LINK, openedAt: null, heardAt: -Infinity }, 20.1), "no_way");
  assert.equal(judge({ ...LINK, heardAt: -Infinity }, 13.4), "waiting");
  assert.equal(judge({ ...LINK, heardAt: -Infinity }, 13.6), "silent");
});
