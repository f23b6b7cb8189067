import assert from "node:assert/strict";
import test from "node:test";

import { createPaint } from "../../../static/js/lib/colours.js";

test("colours are read until all are available, and then no more", () => {
  const sheet = { "--map-floor": " black", "--map-wall": "" };
  let asked = 0;
  globalThis.getComputedStyle = () => {
    asked += 1;
    return { fontFamily: "sans", getPropertyValue: (name) => sheet[name] };
  };
  const paint = createPaint({}, "--map-", ["floor", "wall"], "600 12px");
  assert.deepEqual(paint(), { font: "600 12px sans", floor: "black", wall: "" });
  sheet["--map-wall"] = "white";
  assert.equal(paint().wall, "white");
  assert.equal(paint().wall, "white");
  assert.equal(asked, 2);
});
