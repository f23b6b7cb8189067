import assert from "node:assert/strict";
import { test } from "node:test";

import { newState } from "../../../static/js/drive/features.js";
import { createRecorder } from "../../../static/js/study/recorder.js";

Object.assign(globalThis, {
  addEventListener: () => undefined,
  document: { addEventListener: () => undefined, hidden: false },
  innerWidth: 1280,
  innerHeight: 800,
  screen: { width: 1280, height: 800 },
  devicePixelRatio: 1,
  matchMedia: () => ({ matches: false }),
});
Object.defineProperty(globalThis, "navigator", {
  value: { permissions: { query: async () => ({ state: "prompt" }) } },
  configurable: true,
});

test("a recorder that is loaded during a drive records what already applies, once", async () => {
  const state = newState({});
  state.visit = { ...state.visit, phase: "driving", session: "one" };
  /** @type {string[]} */
  const written = [];
  const recorder = createRecorder({
    get: () => state,
    report: (type, data) => written.push(data?.name ? `${type} ${data.name}` : type) > 0,
    now: () => 0,
    hud: { alertFor: () => null, cardFor: () => null },
  });
  recorder.steered("keyboard");
  await new Promise((heard) => setTimeout(heard));
  assert.deepEqual(written, []);
  recorder.show(state);
  recorder.show(state);
  recorder.steered("keyboard");
  const once = ["layout", "permission camera", "permission microphone", "controller"];
  assert.deepEqual(
    written.filter((type) => once.includes(type)),
    once,
  );
});
