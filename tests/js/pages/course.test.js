import assert from "node:assert/strict";
import { test } from "node:test";

import {
  formatPoints,
  parsePoints,
  rounded,
  stepOf,
  without,
  withMoved,
  withPoint,
} from "../../../static/js/pages/admin/course_points.js";

test("points are read from lines and written to the centimetre", () => {
  assert.deepEqual(parsePoints("1 2\n\n 3,5;-4 \n", "es"), [
    [1, 2],
    [3.5, -4],
  ]);
  assert.equal(
    formatPoints([
      [1.006, 2],
      [-0.001, 3],
    ]),
    "1.01 2\n0 3",
  );
  assert.deepEqual(parsePoints(formatPoints([[0.1, 0.2]])), [[0.1, 0.2]]);
});

test("a line that is no point makes no path", () => {
  for (const text of ["1", "1 2 3", "a b", "1 2\nx"]) {
    assert.equal(parsePoints(text), null);
  }
  assert.deepEqual(parsePoints(""), []);
});

test("a new point is inserted into a near line, else at the end", () => {
  const path = [
    [0, 0],
    [4, 0],
    [4, 4],
  ];
  assert.deepEqual(withPoint(path, [2, 0.2]), [
    [0, 0],
    [2, 0.2],
    [4, 0],
    [4, 4],
  ]);
  assert.deepEqual(withPoint(path, [4.1, 3]), [
    [0, 0],
    [4, 0],
    [4.1, 3],
    [4, 4],
  ]);
  assert.deepEqual(withPoint(path, [0, 4]), [
    [0, 0],
    [4, 0],
    [4, 4],
    [0, 4],
  ]);
  assert.deepEqual(withPoint([], [1, 1]), [[1, 1]]);
  assert.deepEqual(withPoint([[1, 1]], [1, 1.1]), [
    [1, 1],
    [1, 1.1],
  ]);
});

test("a point is moved, and removed while enough are left", () => {
  assert.deepEqual(
    withMoved(
      [
        [0, 0],
        [1, 1],
      ],
      1,
      [2, 2],
    ),
    [
      [0, 0],
      [2, 2],
    ],
  );
  assert.deepEqual(
    without(
      [
        [0, 0],
        [1, 1],
      ],
      0,
      0,
    ),
    [[1, 1]],
  );
  assert.deepEqual(
    without(
      [
        [0, 0],
        [1, 1],
        [2, 2],
      ],
      0,
      3,
    ),
    [
      [0, 0],
      [1, 1],
      [2, 2],
    ],
  );
});

test("arrow keys move by ten centimetres, and by two with shift; up is up on the map", () => {
  assert.deepEqual(stepOf("ArrowUp", false), [0, 0.1]);
  assert.deepEqual(stepOf("ArrowLeft", true), [-0.02, 0]);
  assert.equal(stepOf("Enter", false), null);
});

test("zero is never written as negative", () => {
  assert.equal(Object.is(rounded(-0.001), 0), true);
});
