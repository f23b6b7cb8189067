import assert from "node:assert/strict";
import test from "node:test";

import { lazy } from "../../../static/js/lib/lazy.js";

test("a part that could not be fetched is fetched at the next need, and then kept", async () => {
  const answers = [Promise.reject(new TypeError("no network")), Promise.resolve("part")];
  let fetches = 0;
  const part = lazy(() => answers[fetches++]);
  const seen = [];
  const settle = () => new Promise(setImmediate);
  part(
    (it) => seen.push(it),
    () => seen.push("missing"),
  );
  await settle();
  part((it) => seen.push(it));
  await settle();
  part((it) => seen.push(it));
  await settle();
  assert.deepEqual([seen, fetches], [["missing", "part", "part"], 2]);
});
