import assert from "node:assert/strict";
import { test } from "node:test";

import { ahead, handlesOf, wrapped } from "../../../static/js/pages/admin/plan_handles.js";

const WORDS = { end: "end", heading: "direction" };

/** Fields as the page has them. */
const fieldsOf = (values) => ({
  values,
  read: (name) => values[name] ?? null,
  write: (name, value) => {
    values[name] = value;
  },
});

test("an opening has two ends that move separately", () => {
  const fields = fieldsOf({
    "openings.0.x": "1",
    "openings.0.y": "2",
    "openings.0.x2": "2.5",
    "openings.0.y2": "2",
  });
  const [start, end] = handlesOf(
    { part: "openings.0", kind: "opening", label: "Opening 1" },
    fields,
    WORDS,
  );
  assert.deepEqual(
    [start.at, end.at],
    [
      [1, 2],
      [2.5, 2],
    ],
  );
  end.move([3.004, -0.001]);
  assert.equal(fields.values["openings.0.x2"], "3");
  assert.equal(fields.values["openings.0.y2"], "0");
  assert.equal(fields.values["openings.0.x"], "1");
  assert.equal(end.label, "Opening 1, end");
});

test("the heading of a dock follows its handle", () => {
  const fields = fieldsOf({ "docks.0.x": "1", "docks.0.y": "1", "docks.0.heading": "180.0" });
  const [dock, heading] = handlesOf(
    { part: "docks.0", kind: "dock", label: "Dock" },
    fields,
    WORDS,
  );
  assert.ok(Math.abs(heading.at[0] - 0.4) < 1e-9);
  heading.move([1, 3]);
  assert.equal(fields.values["docks.0.heading"], "90");
  dock.move([4, 5]);
  assert.deepEqual([fields.values["docks.0.x"], fields.values["docks.0.y"]], ["4", "5"]);
});

test("a removed part, or one without numbers, is not on the map", () => {
  const part = { part: "places.0", kind: "place", label: "A" };
  assert.equal(
    handlesOf(part, fieldsOf({ "places.0.x": "1", "places.0.y": "east" }), WORDS).length,
    0,
  );
  const fields = fieldsOf({ "places.0.x": "1", "places.0.y": "2" });
  handlesOf(part, fields, WORDS)[0].remove();
  assert.equal(handlesOf(part, fields, WORDS).length, 0);
  assert.equal(
    handlesOf(
      { part: "rooms.0", kind: "room", label: "Hall" },
      fieldsOf({ "rooms.0.title": "Hall" }),
      WORDS,
    ).length,
    0,
  );
});

test("directions are written within half a turn", () => {
  assert.equal(wrapped(190), -170);
  assert.equal(wrapped(-181), 179);
  assert.equal(wrapped(44.96), 45);
  assert.deepEqual(ahead([1, 2], 0), [1.6, 2]);
});
