/** Numbers as people write them, in the language of the page. */

import { test } from "node:test";
import assert from "node:assert/strict";

import { readDecimal } from "../../../static/js/lib/decimal.js";

test("a comma is the decimal mark only where the language uses it", () => {
  assert.equal(readDecimal("0,5", "es"), 0.5);
  assert.equal(readDecimal("0.5", "es"), 0.5);
  assert.equal(readDecimal("0.5", "en"), 0.5);
  for (const text of ["1,000", "0,5", "", " ", "x"]) {
    assert.ok(Number.isNaN(readDecimal(text, "en")), text);
  }
});

test("a page without a language is English", () => {
  assert.equal(readDecimal(" 0.25 "), 0.25);
  assert.ok(Number.isNaN(readDecimal("1,000")));
});
