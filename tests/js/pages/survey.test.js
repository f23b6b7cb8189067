/** The modules of the questionnaire's page that need no page. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";

import { createAttention } from "../../../static/js/pages/survey/attention.js";
import { shownKeys } from "../../../static/js/pages/survey/conditions.js";
import { moved, stepTo } from "../../../static/js/pages/survey/ranking.js";

const CASES = JSON.parse(
  readFileSync(new URL("../../golden/survey_conditions.json", import.meta.url), "utf8"),
);

for (const { name, questions, said, shown } of CASES) {
  test(`conditions agree with the server: ${name}`, () => {
    const listed = Object.entries(questions).map(([key, condition]) => ({
      key,
      condition: condition && { is: [], at_least: null, at_most: null, ...condition },
    }));
    assert.deepEqual([...shownKeys(listed, (key) => said[key] ?? [])], shown);
  });
}

test("the time before a touch counts for the touched question", () => {
  let now = 100;
  const attention = createAttention(() => now);
  now = 103;
  attention.touch("a");
  now = 104;
  attention.touch("b");
  now = 106;
  attention.touch("a");
  assert.deepEqual(attention.all(), { a: 5, b: 1 });
});

test("time while hidden does not count, and the time before it does", () => {
  let now = 0;
  const attention = createAttention(() => now);
  now = 2;
  attention.setSeen(false);
  attention.setSeen(false);
  now = 50;
  attention.setSeen(true);
  now = 53;
  attention.touch("a");
  attention.setSeen(false);
  now = 90;
  attention.touch("b");
  assert.deepEqual(attention.all(), { a: 5, b: 0 });
});

test("a moved option shifts the others by one place", () => {
  assert.deepEqual(moved(["a", "b", "c", "d"], 3, 0), ["d", "a", "b", "c"]);
  assert.deepEqual(moved(["a", "b", "c", "d"], 0, 2), ["b", "c", "a", "d"]);
  assert.deepEqual(moved(["a", "b", "c", "d"], 1, 1), ["a", "b", "c", "d"]);
});

/**
 * Drag the row called `held` to a height, and return the order once nothing moves; rows are 10 px
 * apart.
 */
const dragged = (heights, held, y) => {
  const names = Object.keys(heights);
  for (let steps = 0; steps < 20; steps += 1) {
    let top = 0;
    const spans = names.map((name) => {
      const span = { top, bottom: top + heights[name] };
      top = span.bottom + 10;
      return span;
    });
    const at = names.indexOf(held);
    const step = stepTo(y, spans[at], spans[at - 1] ?? null, spans[at + 1] ?? null);
    if (step === 0) return names.join("");
    names.splice(at, 1);
    names.splice(at + step, 0, held);
  }
  return "moves for ever";
};

test("a dragged row stops under the pointer", () => {
  const even = { a: 50, b: 50, c: 50 };
  assert.equal(dragged(even, "a", 30), "abc");
  assert.equal(dragged(even, "a", 80), "bac");
  assert.equal(dragged(even, "a", 500), "bca");
  assert.equal(dragged(even, "c", -9), "cab");
});

test("rows of different heights settle wherever one is dragged", () => {
  const uneven = { a: 140, b: 44, c: 80, d: 44 };
  for (const held of "abcd") {
    for (let y = -50; y < 400; y += 1) assert.match(dragged(uneven, held, y), /^[abcd]{4}$/);
  }
});
