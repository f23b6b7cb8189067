import assert from "node:assert/strict";
import { test } from "node:test";

import {
  edited,
  moved,
  openOne,
  press,
  withEdits,
} from "../../../static/js/pages/replay/coding/events.js";
import { outcomeOf } from "../../../static/js/pages/replay/coding/panel.js";

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

test("a key sets a point, starts a state and ends it", () => {
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

test("a state ends the others of its group only", () => {
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

test("a state cannot end before it starts", () => {
  const { events, problems } = pressed([
    [5, "lost"],
    [4, "lost"],
    [5, "sure"],
  ]);
  assert.deepEqual(events, [["lost", 5, null]]);
  assert.deepEqual(problems, ["", "too_early", "too_early"]);
});

test("a change has the version of its base, even if that is not saved yet", () => {
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

test("unsaved changes are shown over the server's events, until deleted", () => {
  const saved = [
    { event: "e", version: 3, code: "help", begin: 2, end: null, modifiers: {}, comment: "" },
  ];
  const change = edited(saved[0], { comment: "again" }, ids());
  assert.deepEqual([change.base, withEdits(saved, [change])[0].comment], [3, "again"]);
  assert.deepEqual(withEdits(saved, [change, edited(saved[0], { is_deleted: true }, ids())]), []);
  assert.equal(openOne(saved, "lost"), undefined);
});

test("a beginning moves within the session and never past its end", () => {
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

test("an answer of the server decides what happens to changes", () => {
  const states = [200, 400, 409, 302, 403, 404, 0, 503].map((status) => {
    const { state, isDone } = outcomeOf({ status, body: null });
    return `${status} ${state}${isDone ? ", done" : ""}`;
  });
  assert.deepEqual(states, [
    ...["200 saved, done", "400 refused", "409 refused"],
    ...["302 signed_out", "403 signed_out", "404 signed_out", "0 waiting", "503 waiting"],
  ]);
});
