import assert from "node:assert/strict";
import { test } from "node:test";

import { isStuck } from "../../../static/js/protocol/link_health.js";
import { Rejection, decodePacket } from "../../../static/js/protocol/robot_api.js";
import { JpegFallback } from "../../../static/js/view/video/jpeg_fallback.js";

const LOOKED_AT = { roundTrip: 0.03, visible: true };
const JPEG = [0xff, 0xd8, 0xff, 0xe0, 1, 2, 3, 0xff, 0xd9];

/** The frame of a picture, as robots/api/picture.py writes it. */
const frameOf = (stamp, jpeg = JPEG, suffix = "picture\n") => {
  const bytes = new Uint8Array(suffix.length + 8 + jpeg.length);
  bytes.set(new TextEncoder().encode(suffix));
  new DataView(bytes.buffer).setFloat64(suffix.length, stamp);
  bytes.set(jpeg, suffix.length + 8);
  return bytes.buffer;
};

const rig = (show = async (_jpeg, isWanted) => isWanted()) => {
  const seen = { asked: [], shown: 0, open: true };
  const slow = new JpegFallback({
    ask: (request) => seen.open && Boolean(seen.asked.push(request)),
    show,
    onShown: () => {
      seen.shown += 1;
    },
  });
  return { slow, seen };
};
const picture = (stamp) => ({ stamp, jpeg: new Uint8Array(JPEG) });
const at = (now) => () => now;

test("no frame is requested before it is needed, and then one", () => {
  const { slow, seen } = rig();
  slow.tick(1, LOOKED_AT);
  slow.start();
  for (let now = 2; now < 3; now += 0.05) {
    slow.tick(now, LOOKED_AT);
  }
  assert.deepEqual(seen.asked, [{ stamp: 2, seen: undefined, roundTrip: 0.03 }]);
});

test("a frame lost with a broker or an agent is requested when the robot is back", () => {
  const { slow, seen } = rig();
  slow.start();
  for (let now = 2; now < 12; now += 0.05) {
    slow.tick(now, LOOKED_AT); // and by now rarely
  }
  const before = seen.asked.length;
  slow.hurry();
  slow.tick(12.05, LOOKED_AT);
  assert.equal(seen.asked.length, before + 1);
  slow.tick(13.6, LOOKED_AT);
  assert.equal(seen.asked.length, before + 2, "and after the usual patience again");
});

test("the next frame is requested when the last one is shown, and names it", async () => {
  const { slow, seen } = rig();
  slow.start();
  slow.tick(2, LOOKED_AT);
  await slow.received(picture(50), at(2.1));
  assert.equal(slow.stamp, 50);
  assert.equal(seen.shown, 1);
  assert.deepEqual(seen.asked.at(-1), { stamp: 2.1, seen: 50, roundTrip: 0.03 });
  assert.equal(seen.asked.length, 2);
});

test("a missing frame is requested again, with growing patience", () => {
  const { slow, seen } = rig();
  slow.start();
  for (let now = 0; now < 30; now += 0.05) {
    slow.tick(now, LOOKED_AT);
  }
  const pauses = seen.asked.slice(1).map(({ stamp }, n) => stamp - seen.asked[n].stamp);
  assert.ok(pauses[0] >= 1.5 && pauses[0] < 1.6, String(pauses));
  assert.ok(pauses.at(-1) >= 6 && pauses.at(-1) < 6.1, String(pauses));
});

test("a request that could not be sent is sent as soon as possible", () => {
  const { slow, seen } = rig();
  slow.start();
  seen.open = false;
  slow.tick(1, LOOKED_AT);
  seen.open = true;
  slow.tick(1.05, LOOKED_AT);
  assert.equal(seen.asked.length, 1);
});

test("a hidden page requests no frames", () => {
  const { slow, seen } = rig();
  slow.start();
  slow.tick(1, { roundTrip: null, visible: false });
  assert.equal(seen.asked.length, 0);
});

test("an older frame than the shown one is dropped, and another is requested", async () => {
  const { slow, seen } = rig();
  slow.start();
  slow.tick(1, LOOKED_AT);
  await slow.received(picture(50), at(1.1));
  await slow.received(picture(49), at(1.2));
  assert.equal(slow.stamp, 50);
  assert.equal(seen.asked.length, 3);
});

test("a robot whose clock was set back is shown again", async () => {
  const { slow } = rig();
  slow.start();
  await slow.received(picture(5000), at(1));
  await slow.received(picture(50), at(2));
  assert.equal(slow.stamp, 50);
});

test("a frame that is no longer wanted is not shown", async () => {
  let finish = () => undefined;
  const { slow, seen } = rig(
    (_jpeg, isWanted) => new Promise((resolve) => (finish = () => resolve(isWanted()))),
  );
  slow.start();
  const drawing = slow.received(picture(50), at(1));
  slow.stop();
  slow.start();
  finish();
  await drawing;
  assert.equal(slow.stamp, null);
  assert.equal(seen.shown, 0);
  slow.stop();
  await slow.received(picture(51), at(2));
  assert.equal(slow.stamp, null);
});

test("a frame that cannot be decoded is followed by another", async () => {
  const { slow, seen } = rig(async () => false);
  slow.start();
  slow.tick(0, LOOKED_AT);
  await slow.received(picture(50), at(0.1));
  assert.equal(slow.stamp, null);
  slow.tick(1.6, LOOKED_AT);
  assert.equal(seen.asked.length, 2);
});

test("frames that arrive while one is decoded are dropped", async () => {
  let drawn = 0;
  let finish = () => undefined;
  const { slow } = rig(
    (_jpeg, isWanted) =>
      new Promise((resolve) => ((drawn += 1), (finish = () => resolve(isWanted())))),
  );
  slow.start();
  const first = slow.received(picture(50), at(1));
  for (let n = 0; n < 100; n += 1) {
    await slow.received(picture(51 + n), at(1));
  }
  finish();
  await first;
  assert.equal(drawn, 1);
});

test("a frame shown for two seconds is outdated", async () => {
  const { slow } = rig();
  slow.start();
  assert.equal(slow.isFresh(1), false);
  await slow.received(picture(50), at(1));
  assert.equal(slow.isFresh(2.9), true);
  assert.equal(slow.isFresh(3.1), false);
});

test("a direct connection is tried for seconds, or shortly without addresses", () => {
  assert.equal(isStuck({ lookingSince: null, barren: true }, 100), false);
  assert.equal(isStuck({ lookingSince: 94, barren: false }, 100), false);
  assert.equal(isStuck({ lookingSince: 92, barren: false }, 100), true);
  assert.equal(isStuck({ lookingSince: 98.5, barren: true }, 100), true);
});

test("a frame is read as it was written", () => {
  const { suffix, message } = decodePacket(frameOf(1766000000.25));
  assert.equal(suffix, "picture");
  assert.equal(message.stamp, 1766000000.25);
  assert.deepEqual([...message.jpeg], JPEG);
});

for (const [why, frame, reason] of [
  ["another suffix", frameOf(1, JPEG, "pictore\n"), "malformed"],
  ["no JPEG", frameOf(1, [1, 2, 3, 4]), "malformed"],
  ["cut short", frameOf(1, JPEG.slice(0, -1)), "malformed"],
  ["no time", frameOf(NaN), "malformed"],
  ["the far future", frameOf(1e12), "malformed"],
  ["nothing behind the suffix", new TextEncoder().encode("picture\n").buffer, "malformed"],
  [
    "too large",
    frameOf(1, [...JPEG.slice(0, 4), ...new Array(60000).fill(0), 0xff, 0xd9]),
    "oversized",
  ],
]) {
  test(`a frame is refused: ${why}`, () => {
    assert.throws(
      () => decodePacket(frame),
      (error) => error instanceof Rejection && error.reason === reason,
    );
  });
}
