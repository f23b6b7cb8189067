import assert from "node:assert/strict";
import { test } from "node:test";

import {
  edited,
  moved,
  openOne,
  press,
  withEdits,
} from "../../../static/js/pages/replay/coding/events.js";
import { SaveQueue } from "../../../static/js/pages/replay/coding/save_queue.js";

const CODES = [
  {
    code: "help",
    name: "Help",
    kind: "point",
    key: "h",
    description: "",
    group: "",
    modifiers: [],
  },
  {
    code: "lost",
    name: "Lost",
    kind: "interval",
    key: "l",
    description: "",
    group: "route",
    modifiers: [],
  },
  {
    code: "sure",
    name: "Sure",
    kind: "interval",
    key: "s",
    description: "",
    group: "route",
    modifiers: [],
  },
  {
    code: "talk",
    name: "Talk",
    kind: "interval",
    key: "t",
    description: "",
    group: "",
    modifiers: [],
  },
];
const ids = () => {
  let n = 0;
  return () => `id${(n += 1)}`;
};

/** Presses keys at moments, one after the other. @param {[number, string][]} presses */
const pressed = (presses) => {
  const newId = ids();
  const edits = [];
  const problems = [];
  for (const [t, name] of presses) {
    const code = CODES.find((one) => one.code === name);
    const found = press(withEdits([], edits), CODES, code, t, newId);
    edits.push(...found.edits);
    problems.push(found.problem);
  }
  return {
    events: withEdits([], edits).map(({ code, begin, end }) => [code, begin, end]),
    problems,
    edits,
  };
};

test("a key sets a point, begins a state and ends it", () => {
  const { events } = pressed([
    [1, "help"],
    [2, "talk"],
    [2.5, "help"],
    [4.0004, "talk"],
  ]);
  assert.deepEqual(events, [
    ["help", 1, null],
    ["talk", 2, 4],
    ["help", 2.5, null],
  ]);
});

test("a state ends the others of its group and leaves the rest on", () => {
  const { events } = pressed([
    [1, "talk"],
    [2, "lost"],
    [5, "sure"],
  ]);
  assert.deepEqual(events, [
    ["talk", 1, null],
    ["lost", 2, 5],
    ["sure", 5, null],
  ]);
});

test("a state cannot end before it begins", () => {
  const { events, problems } = pressed([
    [5, "lost"],
    [4, "lost"],
    [5, "sure"],
  ]);
  assert.deepEqual(events, [["lost", 5, null]]);
  assert.deepEqual(problems, ["", "too_early", "too_early"]);
});

test("a change has the version it was made of, even if the one before is not saved yet", () => {
  const { edits } = pressed([
    [1, "talk"],
    [3, "talk"],
  ]);
  assert.deepEqual(
    edits.map(({ base }) => base),
    [0, 1],
  );
  assert.equal(edits[0].event, edits[1].event);
});

test("changes that are not saved lie over what the server has, until they are deleted", () => {
  const saved = [
    { event: "e", version: 3, code: "help", begin: 2, end: null, modifiers: {}, comment: "" },
  ];
  const change = edited(saved[0], { comment: "again" }, ids());
  assert.deepEqual([change.base, withEdits(saved, [change])[0].comment], [3, "again"]);
  assert.deepEqual(withEdits(saved, [change, edited(saved[0], { is_deleted: true }, ids())]), []);
  assert.equal(openOne(saved, "lost"), undefined);
});

test("a beginning moves within the session and never behind its end", () => {
  const event = {
    event: "e",
    version: 1,
    code: "lost",
    begin: 2,
    end: 4,
    modifiers: {},
    comment: "",
  };
  assert.equal(moved(event, "begin", -1, 60, ids()).begin, 0);
  assert.equal(moved(event, "end", 99, 60, ids()).end, 60);
  assert.equal(moved(event, "begin", 4, 60, ids()), null);
});

// --- saving --------------------------------------------------------------------------------------

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

const edit = (id) => ({
  id,
  event: `e-${id}`,
  base: 0,
  code: "help",
  begin: 1,
  end: null,
  modifiers: {},
  comment: "",
  is_deleted: false,
});
const settled = () => new Promise((resolve) => setImmediate(resolve));

const queueWith = (answers, storage = new MemoryStorage()) => {
  const told = { sent: [], states: [], answers: [], later: [] };
  const queue = new SaveQueue({
    storage,
    key: "coding:1",
    send: async (edits) => {
      told.sent.push(edits.map(({ id }) => id));
      const status = answers.shift();
      if (status === 0) {
        throw new TypeError("no network");
      }
      return { status, body: { saved: [] } };
    },
    onState: (state) => told.states.push(state),
    onAnswer: (answer, sent) => told.answers.push(sent.length),
    later: (seconds, then) => told.later.push([seconds, then]),
    now: () => 1_000,
  });
  return { queue, told, storage };
};

test("what is saved is forgotten", async () => {
  const { queue, told, storage } = queueWith([200]);
  queue.add([edit("a")]);
  assert.equal(Object.keys(storage).length, 1);
  await settled();
  assert.deepEqual(
    [told.states.at(-1), queue.pending.length, Object.keys(storage).length],
    ["saved", 0, 0],
  );
});

test("offline, changes wait in order, and are sent again after longer pauses", async () => {
  const { queue, told } = queueWith([0, 503, 200, 200]);
  queue.add([edit("a")]);
  await settled();
  queue.add([edit("b")]);
  await settled();
  assert.equal(told.states.at(-1), "waiting");
  assert.deepEqual(
    told.later.map(([seconds]) => seconds),
    [1],
  );
  told.later[0][1]();
  await settled();
  assert.deepEqual(told.sent, [["a"], ["a", "b"], ["a", "b"]]);
  assert.equal(told.states.at(-1), "saved");
});

test("a page that is loaded again sends what the one before it could not", async () => {
  const first = queueWith([0]);
  first.queue.add([edit("a"), edit("b")]);
  await settled();
  first.storage["coding:2:x"] = JSON.stringify(edit("of another session"));
  first.storage["coding:1:broken"] = "{";
  const again = queueWith([200], first.storage);
  assert.deepEqual(
    again.queue.pending.map(({ id }) => id),
    ["a", "b"],
  );
  await again.queue.flush();
  assert.deepEqual(again.told.sent, [["a", "b"]]);
  assert.deepEqual(Object.keys(first.storage), ["coding:2:x", "coding:1:broken"]);
});

test("it is told when all is saved, or that it is not", async () => {
  const { queue } = queueWith([200, 200, 0]);
  assert.equal(await queue.settled(), true);
  queue.add([edit("a")]);
  queue.add([edit("b")]); // while the first one is on its way
  assert.equal(await queue.settled(), true);
  queue.add([edit("c")]);
  assert.equal(await queue.settled(), false);
});

test("what the server does not take is kept, and the page says why", async () => {
  for (const [status, state] of [
    [409, "refused"],
    [403, "signed_out"],
    [302, "signed_out"],
  ]) {
    const { queue, told } = queueWith([status]);
    queue.add([edit("a")]);
    await settled();
    assert.deepEqual([told.states.at(-1), queue.pending.length], [state, 1]);
  }
});
