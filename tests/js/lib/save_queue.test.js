/** The queue of answers and codes that are not saved yet. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { SaveQueue } from "../../../static/js/lib/save_queue.js";

class MemoryStorage {
  setItem(name, value) {
    this[name] = value;
  }
  getItem(name) {
    return this[name] ?? null;
  }
  removeItem(name) {
    delete this[name];
  }
}

const SAVED = { state: "saved", isDone: true };
const LOST = { state: "waiting" };
const settled = () => new Promise((resolve) => setImmediate(resolve));
const change = (id, key = id) => ({ id, key });

/** A queue whose requests have these outcomes. */
const queueWith = (outcomes, { storage = new MemoryStorage(), ...options } = {}) => {
  const seen = { sent: [], states: [], later: [] };
  const queue = new SaveQueue({
    storage,
    key: "coding:1",
    send: async (changes) => {
      seen.sent.push(changes.map(({ id }) => id));
      return outcomes.shift();
    },
    onState: (state, changes, outcome) => seen.states.push([state, outcome?.body?.error]),
    later: (seconds, then) => seen.later.push([seconds, then]),
    now: () => 1_000,
    ...options,
  });
  return { queue, seen, storage };
};

test("saved changes are removed from the storage", async () => {
  const { queue, seen, storage } = queueWith([SAVED]);
  queue.add([change("a")]);
  assert.equal(Object.keys(storage).length, 1);
  await settled();
  assert.deepEqual(
    seen.states.map(([state]) => state),
    ["saving", "saved"],
  );
  assert.deepEqual([queue.pending.length, Object.keys(storage).length], [0, 0]);
});

test("changes wait in order while offline, and are sent again", async () => {
  const { queue, seen } = queueWith([LOST, LOST, SAVED]);
  queue.add([change("a")]);
  await settled();
  queue.add([change("b")]);
  await settled();
  assert.equal(seen.states.at(-1)[0], "waiting");
  assert.equal(seen.later.length, 1);
  seen.later[0][1]();
  await settled();
  assert.deepEqual(seen.sent, [["a"], ["a", "b"], ["a", "b"]]);
  assert.equal(seen.states.at(-1)[0], "saved");
});

test("pauses between attempts become longer up to a limit", async () => {
  const { queue, seen } = queueWith([...Array(6).fill(LOST), SAVED]);
  queue.add([change("a")]);
  for (let n = 0; n < 6; n += 1) {
    await settled();
    seen.later.at(-1)[1]();
  }
  await settled();
  assert.deepEqual(
    seen.later.map(([seconds]) => seconds),
    [1, 2, 4, 8, 15, 15],
  );
  assert.equal(queue.pending.length, 0);
});

test("a reloaded page sends the changes that are left, and ignores others", async () => {
  const first = queueWith([LOST]);
  first.queue.add([change("a"), change("b")]);
  await settled();
  first.storage["coding:2:x"] = JSON.stringify(change("of another session"));
  first.storage["coding:1:broken"] = "{";
  const again = queueWith([SAVED], { storage: first.storage });
  assert.deepEqual(
    again.queue.pending.map(({ id }) => id),
    ["a", "b"],
  );
  await again.queue.flush();
  assert.deepEqual(again.seen.sent, [["a", "b"]]);
  assert.deepEqual(Object.keys(first.storage), ["coding:2:x", "coding:1:broken"]);
});

test("a caller waits until all changes are saved, or have failed", async () => {
  const { queue } = queueWith([SAVED, SAVED, LOST]);
  assert.equal(await queue.settled(), true);
  queue.add([change("a")]);
  queue.add([change("b")]); // while the first one is being sent
  assert.equal(await queue.settled(), true);
  queue.add([change("c")]);
  assert.equal(await queue.settled(), false);
});

test("changes that may be accepted later are kept, without another attempt", async () => {
  for (const state of ["refused", "signed_out"]) {
    const { queue, seen } = queueWith([{ state }]);
    queue.add([change("a")]);
    await settled();
    assert.deepEqual([seen.states.at(-1)[0], queue.pending.length], [state, 1]);
    assert.equal(seen.later.length, 0);
  }
});

test("a refused change is removed, and the next one is sent", async () => {
  const refusal = { state: "refused", isDone: true, body: { error: "Too large." } };
  const { queue, seen } = queueWith([refusal, SAVED], { most: 1 });
  queue.add([change("a"), change("b")]);
  await settled();
  assert.deepEqual(seen.sent, [["a"], ["b"]]);
  assert.deepEqual(seen.states[1], ["refused", "Too large."]);
  assert.equal(queue.pending.length, 0);
});

test("a newer answer replaces the one before it, even while that is being sent", async () => {
  const replaces = (old, { key }) => old.key === key;
  const { queue, seen } = queueWith([SAVED, SAVED, SAVED], { most: 1, replaces });
  queue.add([change("1", "a")]);
  queue.add([change("2", "b")]);
  queue.add([change("3", "b")]);
  queue.add([change("4", "a")]);
  await settled();
  assert.deepEqual(seen.sent, [["1"], ["3"], ["4"]]);
  assert.equal(queue.pending.length, 0);
});
