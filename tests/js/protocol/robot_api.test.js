import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";

import {
  Rejection,
  decode,
  decodePacket,
  encodePacket,
} from "../../../static/js/protocol/robot_api.js";

const golden = (name) =>
  JSON.parse(readFileSync(new URL(`../../golden/${name}.json`, import.meta.url), "utf8"));
const TOPICS = [
  "factsheet",
  "state",
  "pose",
  "scan",
  "path",
  "event",
  "action",
  "words",
  "receipt",
  "pointer",
  "heartbeat",
  "media",
  "signal-reply",
];
const WIRE = golden("wire");

/** Every field that the sender wrote and this page knows must come out as it was written. */
const assertHolds = (read, written) => {
  for (const [key, value] of Object.entries(read)) {
    if (Object.hasOwn(written, key)) {
      if (value !== null && typeof value === "object" && !Array.isArray(value)) {
        assertHolds(value, written[key]);
      } else if (!(Array.isArray(value) && typeof value[0] === "object")) {
        assert.deepEqual(value, written[key], key);
      }
    }
  }
};

for (const topic of TOPICS) {
  const file = golden(topic);
  const suffix = file.suffix.replace("/+", "");
  for (const [name, message] of Object.entries(file.messages)) {
    test(`the golden message ${suffix} (${name}) is read as it was written`, () => {
      const read = decodePacket(encodePacket(suffix, message));
      assert.equal(read.suffix, suffix);
      assertHolds(read.message, message);
    });
  }
}

for (const [suffix, examples] of Object.entries(WIRE.toPage)) {
  for (const [name, message] of Object.entries(examples)) {
    test(`the server's message ${suffix} (${name}) is read as it was written`, () =>
      assertHolds(decode(suffix, JSON.stringify(message)), message));
  }
}

test("every message of the server to a page has an example", () => {
  assert.deepEqual(
    Object.keys(WIRE.toPage).filter((suffix) => Object.keys(WIRE.toPage[suffix]).length === 0),
    [],
  );
});

test("a missing field has its default", () => {
  const state = decode("state", JSON.stringify(golden("state").messages.least));
  assert.equal(state.safety.estop, false);
  assert.equal(state.safety.stopId, null);
  assert.equal(state.pose.localized, true);
  assert.deepEqual(state.applied, []);
  assert.equal(decode("media", JSON.stringify(golden("media").messages.least)).rate, 90000);
  assert.equal(
    decode("session/granted", JSON.stringify(WIRE.toPage["session/granted"].least)).limits.linear,
    null,
  );
});

for (const { why, suffix, payload, reason } of golden("refused")) {
  test(`refused: ${why}`, () => {
    assert.throws(
      () => decode(suffix, payload),
      (error) => error instanceof Rejection && error.reason === reason,
    );
  });
}

test("a frame without a suffix, and one that is not text, are malformed", () => {
  for (const frame of ["{}", "", new ArrayBuffer(3), null]) {
    assert.throws(
      () => decodePacket(frame),
      (error) => error instanceof Rejection && error.reason === "malformed",
    );
  }
});

test("a suffix named like a method of every object is unknown", () => {
  for (const suffix of ["constructor", "toString", "__proto__"]) {
    assert.throws(
      () => decode(suffix, "{}"),
      (error) => error instanceof Rejection && error.reason === "unknown_topic",
    );
  }
});

test("a field that JavaScript leaves undefined is not sent", () => {
  assert.equal(
    encodePacket("command/velocity", { seq: 1, frame: undefined }),
    'command/velocity\n{"seq":1}',
  );
});

test("a deeply nested bomb is malformed, not a crash", () => {
  assert.throws(() => decode("action", '{"a":'.repeat(600) + "1" + "}".repeat(600)), Rejection);
});
