import assert from "node:assert/strict";
import { test } from "node:test";

import { courseOf, trailOf } from "../../../static/js/pages/live/course.js";
import { doorStates, driverOf } from "../../../static/js/pages/live/labels.js";

const stop = (number) => ({ number, x: number, y: 0, radius: 0.5, title: "" });
const course = {
  checkpoints: [stop(0), stop(1), stop(2)],
  dock: { x: 0, y: 0, theta: 0 },
  path: [
    [0, 0],
    [2, 0],
  ],
  zones: [],
};
const statuses = (marks) => marks.stops.map(({ number, status }) => [number, status]);

test("a door is drawn as reported, else as set for the drive, else for the robot", () => {
  const robot = {
    doors: [
      { name: "said", set: "open", confirmed: "closed" },
      { name: "assigned", set: "open", confirmed: null },
      { name: "set", set: "closed", confirmed: null },
    ],
  };
  const drive = { doors: { said: "open", assigned: "closed" } };
  assert.deepEqual(doorStates(robot, drive), { said: "closed", assigned: "closed", set: "closed" });
  assert.deepEqual(doorStates(robot, null), { said: "closed", assigned: "open", set: "closed" });
});

test("the driver's line has the number of errors in the page", () => {
  const drive = { heard: null, code: "P1", kind: "", number: 1, condition: "", state: "" };
  const words = { say: (word, values) => (values?.n ? `${word} ${values.n}` : "") };
  assert.match(driverOf({ ...drive, script_errors: 2 }, words), /script_errors 2/);
  assert.doesNotMatch(driverOf({ ...drive, script_errors: 0 }, words), /script_errors/);
});

test("the course of a drive has its passed and next checkpoints", () => {
  const task = { cue: "go_to_checkpoint", number: 2, passed: [1], checkpoints: 2, remaining: null };
  const marks = courseOf({ 1: course, 2: { ...course, path: [] } }, 2, { version: 1, task });
  assert.deepEqual(statuses(marks), [
    [1, "passed"],
    [2, "next"],
    [0, "later"],
  ]);
  assert.deepEqual(marks.path, course.path);
});

test("without a drive there is no next checkpoint, without a task no course", () => {
  const marks = courseOf({ 2: course }, 2, null);
  assert.deepEqual(statuses(marks), [
    [1, "later"],
    [2, "later"],
    [0, "later"],
  ]);
  assert.equal(courseOf({ 2: course }, 2, { version: 2, task: null }), null);
  assert.equal(courseOf({}, 2, null), null);
});

test("the path so far has only localized positions", () => {
  assert.deepEqual(trailOf({ x: [0, 1, 2], y: [0, 0, 1], localized: [1, 0, 1] }), [
    [0, 0],
    [2, 1],
  ]);
});
