/** Whether a drive elsewhere is in another tab of this browser. */

import { test } from "node:test";
import assert from "node:assert/strict";

import { newOwnTabs } from "../../../static/js/drive/own_tabs.js";

/** Shared locks, as the browser has them for all pages of a site. */
const newLocks = () => {
  const held = new Set();
  return {
    request: async (name, { mode }, work) => {
      assert.equal(mode, "shared");
      const lock = { name };
      held.add(lock);
      await work(lock);
      held.delete(lock);
    },
    query: async () => ({ held: [...held] }),
  };
};

test("a driving page is found by pages of the same browser only", async () => {
  const [here, there] = [newLocks(), newLocks()];
  const [driver, other] = [newOwnTabs("giraff", here), newOwnTabs("giraff", here)];
  driver.mark(true);
  assert.equal(await other.find(), "browser");
  assert.equal(await newOwnTabs("rhodon", here).find(), "device");
  assert.equal(await newOwnTabs("giraff", there).find(), "device");
  driver.mark(false);
  assert.equal(await driver.find(), "device", "its own drive is over");
  assert.equal(await other.find(), "device");
});

test("a page without locks does not guess", async () => {
  const tabs = newOwnTabs("giraff", null);
  tabs.mark(true);
  assert.equal(await tabs.find(), "");
});
