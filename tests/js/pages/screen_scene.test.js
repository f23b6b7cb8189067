import assert from "node:assert/strict";
import test from "node:test";

import { sceneFor, troubleOf } from "../../../static/js/pages/screen/scene.js";

const told = (state, changes = {}) => ({
  keyed: true,
  online: true,
  heardAt: 100,
  stop: null,
  screen: { title: "Giraff", session: "s1", visitor: "Ada", study: false },
  state: { viewers: 0, session: null, call: null, safety: { estop: false }, ...state },
  ...changes,
});
const RUNS_ON = { errors: ["runs_on: the robot keeps moving"] };
const STOPPED = { safety: { estop: true, estopSource: "screen:hall" } };
const watching = (...given) => sceneFor(told(...given), 100).watching;

test("people at the robot see the number of viewers, without the driver", () => {
  assert.equal(watching({ viewers: 12 }), 12);
  assert.equal(watching({ viewers: 13, session: "s1" }), 12);
  assert.equal(watching({ viewers: 0, session: "s1" }), 0);
  assert.equal(watching({ viewers: 12 }, { online: false }), 0);
  assert.equal(watching({}, { state: null }), 0);
});

test("people at the robot are asked to tap while the browser keeps the visitor silent", () => {
  const call = { status: "accepted", audio: true, video: false, volume: 1 };
  const text = (sounds) => sceneFor(told({ call }, { sounds }), 100).text;
  assert.deepEqual([text(false), text(true)], ["silent", "speaking"]);
});

test("a waiting visitor at a stopped robot and people there can write to each other", () => {
  const waits = { title: "Giraff", session: null, visitor: null, waiting: "Ben", study: false };
  const scene = sceneFor(told({ safety: { estop: true } }, { screen: waits }), 100);
  assert.deepEqual([scene.scene, scene.name, scene.canWrite], ["waiting", "Ben", true]);
  assert.deepEqual([scene.canHangUp, scene.sound], [false, 0]);
  const nobody = sceneFor(told({}, { screen: { ...waits, waiting: null } }), 100);
  assert.deepEqual([nobody.scene, nobody.canWrite], ["idle", false]);
  const alone = sceneFor(told({ mode: "docking" }, { screen: { ...waits, waiting: null } }), 100);
  assert.equal(alone.scene, "returning");
  const away = sceneFor(told({}, { screen: waits, online: false }), 100);
  assert.deepEqual([away.scene, away.canWrite], ["offline", false]);
});

test("a release of a stop is confirmed first, within a limited time", () => {
  const at = (now, fields) => {
    const { stopped, release } = sceneFor(told(STOPPED, fields), now);
    return [stopped, release];
  };
  assert.deepEqual(at(100, { askedAt: null }), ["ours", "offered"]);
  assert.deepEqual(at(101, { askedAt: 100 }), ["sure", "sure"]);
  assert.deepEqual(at(116, { askedAt: 100 }), ["ours", "offered"]);
  const moving = told({ safety: { estop: false } }, { askedAt: 100 });
  assert.equal(sceneFor(moving, 101).release, "");
});

test("people at a robot that was stopped between sessions can release it", () => {
  const held = { safety: { estop: false, inhibited: "stopped" } };
  const nobody = { title: "Giraff", session: null, visitor: null, study: false };
  const at = (screen) => {
    const { stopped, release } = sceneFor(told(held, { screen }), 100);
    return [stopped, release];
  };
  assert.deepEqual(at(nobody), ["held", "offered"]);
  assert.deepEqual(at({ ...nobody, session: "s1", visitor: "Ada" }), ["", ""]);
});

test("a release is shown as in progress, and so is a missing answer", () => {
  const at = (now, release) => {
    const { stopped, release: button } = sceneFor(told(STOPPED, { release }), now);
    return [stopped, button];
  };
  const asked = { id: "r", since: 100, refused: false };
  assert.deepEqual(at(100, null), ["ours", "offered"]);
  assert.deepEqual(at(102, asked), ["ours", "asked"]);
  assert.deepEqual(at(105, asked), ["unreleased", "offered"]);
  assert.deepEqual(at(101, { ...asked, refused: true }), ["unreleased", "offered"]);
  const other = told({ safety: { estop: true, estopSource: "owner:Ana" } }, { release: asked });
  assert.equal(sceneFor(other, 101).release, "");
});

test("people at the robot see that it moves although it should be at rest", () => {
  const { stopped } = sceneFor(told({ ...RUNS_ON, ...STOPPED }), 100);
  assert.equal(stopped, "runs_on");
  assert.equal(sceneFor(told(STOPPED), 100).stopped, "ours");
});

test("people at the robot see that the server fails, is silent, or denied a request", () => {
  const troubles = (changes, silence = 0, now = 100) =>
    troubleOf({ ...told({}), ...changes }, silence, now);
  assert.equal(troubles({}), "");
  assert.equal(troubles({ trouble: "missing" }), "give.missing");
  const failing = { trouble: "missing", failing: true };
  assert.equal(troubles({ ...failing, linked: true }), "server.failing");
  assert.equal(troubles(failing), "server.failing_unlinked", "a stop may not reach the robot");
  assert.equal(troubles({ failing: true }, 2), "server.silent");
  const denied = { actedAt: 99, deniedAt: 99.5 };
  assert.equal(troubles(denied), "denied");
  assert.equal(troubles(denied, 0, 120), "");
  assert.equal(troubles({ ...denied, actedAt: 50 }), "", "of what is repeated by itself");
  assert.equal(troubles({ ...denied, actedAt: 99.8 }), "", "of what was asked before");
});
