import assert from "node:assert/strict";
import { describe, test } from "node:test";

import {
  RemotePointer,
  EVERY,
  Hand,
  STAYS,
  frameOf,
  spotIn,
} from "../../../static/js/presence/pointer_state.js";

describe("a spot of a video", () => {
  const WIDE = { width: 1280, height: 720 };

  test("is the same in a small preview and on a tall display with bars", () => {
    const small = frameOf(WIDE, 160, 90, "contain");
    const tall = frameOf(WIDE, 800, 1000, "contain");
    assert.deepEqual(small, { left: 0, top: 0, width: 160, height: 90 });
    assert.deepEqual(tall, { left: 0, top: 275, width: 800, height: 450 });
    assert.deepEqual(spotIn(small, { clientX: 40, clientY: 67.5 }), [0.25, 0.75]);
    assert.deepEqual(spotIn(tall, { clientX: 200, clientY: 275 + 337.5 }), [0.25, 0.75]);
  });

  test("counts from the corner of the image, with bars or with cut edges", () => {
    assert.deepEqual(frameOf({ width: 720, height: 1280 }, 800, 640, "contain"), {
      left: 220,
      top: 0,
      width: 360,
      height: 640,
    });
    assert.deepEqual(frameOf(WIDE, 800, 600, "cover"), {
      left: (800 - (600 * 16) / 9) / 2,
      top: 0,
      width: (600 * 16) / 9,
      height: 600,
    });
  });

  test("of a pointer outside of the image is at its edge", () => {
    assert.deepEqual(
      spotIn({ left: 10, top: 10, width: 100, height: 50 }, { clientX: 300, clientY: -5 }),
      [1, 0],
    );
  });
});

describe("our own pointer", () => {
  test("is sent at most fifteen times a second, with its latest spot", () => {
    const hand = new Hand();
    const said = [];
    for (let tick = 0; tick <= 100; tick += 1) {
      hand.is([tick / 100, 0.5], true);
      const at = hand.take(tick / 100);
      if (at) {
        said.push(at[0]);
      }
    }
    assert.equal(said[0], 0);
    assert.ok(said.length >= 13 && said.length <= 16, `${said.length} in a second`);
    assert.ok(said.every((at, index) => index === 0 || at - said[index - 1] >= EVERY - 1e-9));
  });

  test("at rest is sent again before its dot disappears, while pressed and not hovering", () => {
    const hand = new Hand();
    hand.is([0.5, 0.5], true);
    const at = [0, 0.1, 0.5, 0.9, 1.0, 1.8].filter((now) => hand.take(now));
    assert.deepEqual(at, [0, 0.9, 1.8]);
    assert.ok(at[1] - at[0] < STAYS);
    hand.is([0.5, 0.5], false);
    assert.equal(hand.take(100), undefined);
  });

  test("that has left is sent at once and once, if it was sent before", () => {
    const hand = new Hand();
    assert.equal(hand.take(0), undefined);
    hand.is([0.1, 0.2], true);
    assert.deepEqual(hand.take(1), [0.1, 0.2]);
    hand.is(null);
    assert.equal(hand.take(1.001), null);
    assert.equal(hand.take(9), undefined);
  });
});

test("that crosses the edge is sent no more often than one that moves", () => {
  const hand = new Hand();
  let said = 0;
  for (let tick = 0; tick < 1000; tick += 1) {
    hand.is(tick % 8 < 4 ? [0.5, tick / 1000] : null);
    said += Number(hand.take(tick / 1000) !== undefined);
  }
  assert.ok(said >= 10 && said <= 18, `${said} in a second`);
});

describe("the dot of the other side", () => {
  const told = (dot, stamp, at, now = stamp) => dot.receive({ stamp, at }, now);

  test("stays for two seconds after its last message", () => {
    const dot = new RemotePointer();
    assert.equal(dot.at(0), null);
    told(dot, 10, [0.1, 0.2]);
    told(dot, 11, [0.3, 0.4]);
    assert.deepEqual(dot.at(12.9), [0.3, 0.4]);
    assert.equal(dot.at(13), null);
  });

  test("disappears when the pointer is lifted, but that of a tap is shown first", () => {
    const dot = new RemotePointer();
    told(dot, 10, [0.1, 0.2]);
    told(dot, 11.5, null);
    assert.equal(dot.at(11.5), null);
    told(dot, 20, [0.5, 0.5]);
    told(dot, 20.1, null);
    assert.deepEqual(dot.at(20.7), [0.5, 0.5]);
    assert.equal(dot.at(20.8), null);
    told(dot, 20.9, [0.6, 0.6]);
    told(dot, 21.0, null);
    assert.deepEqual(dot.at(21.6), [0.6, 0.6], "a second tap is as long as the first");
  });

  test("ignores late and repeated messages", () => {
    const dot = new RemotePointer();
    told(dot, 10, [0.1, 0.1]);
    told(dot, 10.2, null, 10.9);
    told(dot, 10.1, [0.2, 0.2], 10.95);
    assert.equal(dot.at(10.96), null);
    told(dot, 11, [0.3, 0.3], 11);
    told(dot, 11, [0.3, 0.3], 11.2);
    assert.deepEqual(dot.at(11.3), [0.3, 0.3]);
  });

  test("appears again after the other's clock was set back", () => {
    const dot = new RemotePointer();
    told(dot, 1000, [0.1, 0.1], 10);
    told(dot, 500, [0.2, 0.2], 11);
    assert.deepEqual(dot.at(11), [0.1, 0.1]);
    told(dot, 502, [0.2, 0.2], 12.5);
    assert.deepEqual(dot.at(12.6), [0.2, 0.2]);
  });
});
