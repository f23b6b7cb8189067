/** The features of the drive page and their registry: static/js/drive/registry.js. */

import assert from "node:assert/strict";
import { describe, test } from "node:test";

import { FIRST, LATER, SLICES, newState } from "../../../static/js/drive/features.js";
import { Registry } from "../../../static/js/drive/registry.js";
import { createScheduler } from "../../../static/js/drive/scheduler.js";

/** Collects the errors that features' boundaries note during a test. */
const notedErrors = (context) => {
  const errors = [];
  globalThis.reportError = ({ message }) => errors.push(message);
  context.after(() => delete globalThis.reportError);
  return errors;
};

describe("an error in a feature", () => {
  const fail = () => {
    throw new Error("broken");
  };

  test("is noted and does not stop other features", (context) => {
    const [errors, registry, log] = [notedErrors(context), new Registry(), []];
    const parts = (run) => ({ handlers: { state: run }, on: { tick: run }, render: run });
    registry.add({ ...parts(fail), actions: { sound: fail } });
    registry.add(parts(() => log.push("ran")));
    assert.equal(registry.handle("state", {}, "mqtt"), true);
    registry.emit("tick", 1);
    registry.render({});
    assert.equal(registry.act("sound"), true);
    assert.deepEqual(log, ["ran", "ran", "ran"]);
    assert.deepEqual(errors, ["broken", "broken", "broken", "broken"]);
  });

  test("does not delay the velocity, which is sent first in each tick", (context) => {
    const [errors, log] = [notedErrors(context), []];
    context.mock.timers.enable({ apis: ["setInterval"] });
    const registry = new Registry();
    registry.add({ on: { tick: () => log.push("tick"), poll: fail, second: fail } });
    createScheduler({
      store: { update: () => undefined },
      emit: registry.emit.bind(registry),
      connection: { grantedAt: () => -Infinity },
      driving: { sendVelocity: () => log.push("velocity") },
      video: { frameAge: () => null },
    }).begin();
    context.mock.timers.tick(100);
    assert.deepEqual(log, ["velocity", "tick", "velocity", "tick"]);
    assert.deepEqual(errors, ["broken", "broken"]);
  });
});

describe("the registry", () => {
  test("passes a message to each feature with a handler and reports when there is none", () => {
    const [registry, log] = [new Registry(), []];
    registry.add({
      handlers: { state: (message, transport) => log.push(["one", message, transport]) },
    });
    registry.add({ handlers: { state: () => log.push("two") } });
    assert.equal(registry.handle("state", 1, "mqtt"), true);
    assert.equal(registry.handle("hello", 1, "mqtt"), false);
    assert.deepEqual(log, [["one", 1, "mqtt"], "two"]);
  });

  test("runs an action by its name with its argument and reports when there is none", () => {
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

  test("renders all features and calls the listeners of an event", () => {
    const [registry, log] = [new Registry(), []];
    registry.add({
      render: (state) => log.push(`render ${state}`),
      on: { tick: (now) => log.push(now) },
    });
    registry.add({ render: (state) => log.push(`again ${state}`) });
    registry.emit("tick", 7);
    registry.emit("an event without listeners");
    registry.render("it");
    assert.deepEqual(log, [7, "render it", "again it"]);
  });
});

describe("a feature that is loaded later", () => {
  const late = (registry) => {
    const log = [];
    registry.add({
      handlers: { path: (message) => log.push(message), pose: () => log.push("pose") },
      on: { granted: (lease) => log.push(lease), tick: () => log.push("tick") },
      render: () => log.push("render"),
    });
    return log;
  };

  test("receives once, in order, what it missed, except for frequent messages", () => {
    const [registry, first] = [new Registry(), []];
    registry.add({ handlers: { path: () => first.push("path") } });
    registry.emit("granted", "lease");
    registry.emit("tick", 1);
    registry.handle("path", "points", "mqtt");
    registry.handle("pose", {}, "mqtt");
    assert.deepEqual(late(registry), ["lease", "points"]);
    assert.deepEqual(first, ["path"]);
  });

  test("receives new events, and no old ones after all features are loaded", () => {
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

  test("have different names", () => {
    const names = all.map(({ name }) => name);
    assert.equal(new Set(names).size, names.length);
  });

  test("have slices of the state that do not overlap", () => {
    const fields = SLICES.flatMap((newSlice) => Object.keys(newSlice()));
    assert.deepEqual([...new Set(fields)].sort(), [...fields].sort());
    assert.deepEqual(Object.keys(newState()).sort(), [...fields].sort());
  });
});
