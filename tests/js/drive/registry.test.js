/** What the features of the drive page bring: static/js/drive/registry.js, and which there are. */

import assert from "node:assert/strict";
import { describe, test } from "node:test";

import { FIRST, LATER, SLICES, newState } from "../../../static/js/drive/features.js";
import { Registry } from "../../../static/js/drive/registry.js";

describe("the registry", () => {
  test("hands a message to every feature that takes it, in order, and says when none does", () => {
    const [registry, log] = [new Registry(), []];
    registry.add({
      handlers: { state: (message, transport) => log.push(["one", message, transport]) },
    });
    registry.add({ handlers: { state: () => log.push("two") } });
    assert.equal(registry.handle("state", 1, "mqtt"), true);
    assert.equal(registry.handle("hello", 1, "mqtt"), false);
    assert.deepEqual(log, [["one", 1, "mqtt"], "two"]);
  });

  test("runs an action by its name, with its argument, and says when there is none", () => {
    const [registry, log] = [new Registry(), []];
    registry.add({
      actions: {
        stop: () => log.push("stop"),
        speed: (step) => log.push(`speed ${step}`),
        go_to: (place) => log.push(`to ${place}`),
      },
    });
    const done = ["stop", "speed-2", "go_to:room-1:west", "drive"].map((action) =>
      registry.act(action),
    );
    assert.deepEqual(log, ["stop", "speed 2", "to room-1:west"]);
    assert.deepEqual(done, [true, true, true, false]);
  });

  test("renders all features and tells those that listen what happens", () => {
    const [registry, log] = [new Registry(), []];
    registry.add({
      render: (state) => log.push(`render ${state}`),
      on: { tick: (now) => log.push(now) },
    });
    registry.add({ render: (state) => log.push(`again ${state}`) });
    registry.emit("tick", 7);
    registry.emit("nothing that anybody listens to");
    registry.render("it");
    assert.deepEqual(log, [7, "render it", "again it"]);
  });
});

describe("a feature that comes later than the first", () => {
  const late = (registry) => {
    const log = [];
    registry.add({
      handlers: { path: (message) => log.push(message), pose: () => log.push("pose") },
      on: { granted: (lease) => log.push(lease), tick: () => log.push("tick") },
      render: () => log.push("render"),
    });
    return log;
  };

  test("hears once, in order, what it missed, but for what comes again by itself", () => {
    const [registry, first] = [new Registry(), []];
    registry.add({ handlers: { path: () => first.push("path") } });
    registry.emit("granted", "lease");
    registry.emit("tick", 1);
    registry.handle("path", "points", "mqtt");
    registry.handle("pose", {}, "mqtt");
    assert.deepEqual(late(registry), ["lease", "points"]);
    assert.deepEqual(first, ["path"]);
  });

  test("hears from then on what happens, and nothing of before once all features are there", () => {
    const registry = new Registry();
    const log = late(registry);
    registry.emit("granted", "lease");
    registry.complete();
    registry.handle("pose", {}, "mqtt");
    assert.deepEqual(log, ["lease", "pose"]);
    assert.deepEqual(late(registry), []);
  });
});

describe("the features", async () => {
  const all = [...FIRST, ...(await Promise.all(LATER.map((fetch) => fetch())))];

  test("have names of their own", () => {
    const names = all.map(({ name }) => name);
    assert.equal(new Set(names).size, names.length);
  });

  test("keep what they show in slices that do not overlap", () => {
    const fields = SLICES.flatMap((newSlice) => Object.keys(newSlice()));
    assert.deepEqual([...new Set(fields)].sort(), [...fields].sort());
    assert.deepEqual(Object.keys(newState()).sort(), [...fields].sort());
  });
});
