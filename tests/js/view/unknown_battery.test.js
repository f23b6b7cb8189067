import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";

import { newVisit } from "../../../static/js/protocol/session.js";
import { createReadings } from "../../../static/js/view/hud/readings.js";
import { createWords } from "../../../static/js/lib/words.js";
import { batteryOf } from "../../../static/js/pages/live/labels.js";
import { readingsAt } from "../../../static/js/pages/replay/readings.js";
import { decode } from "../../../static/js/protocol/robot_api.js";
import { newState } from "../../../static/js/drive/features.js";

const TEMPLATE = readFileSync(
  new URL("../../../templates/sessions/_words.html", import.meta.url),
  "utf8",
);
const PAIRS = Array.from(
  TEMPLATE.matchAll(/data-word="([^"]+)">(?:\{% translate "([^"]*)".*?%\}|([^<]*))<\/p>/g),
  ([, key, text, plain]) => [key, text ?? plain],
);
const words = createWords(new Map(PAIRS), "en");

const fakeElement = () => {
  const attributes = new Set();
  return {
    hidden: false,
    dataset: {},
    textContent: "",
    attributes,
    style: { setProperty: () => {} },
    toggleAttribute: (name, on) => (on ? attributes.add(name) : attributes.delete(name)),
  };
};

const shown = (battery, more = {}) => {
  const elements = new Map();
  const element = (id) => elements.get(id) ?? elements.set(id, fakeElement()).get(id);
  createReadings(
    element,
    words,
  )({ ...newState(), visit: newVisit(), robot: { battery, safety: {} }, ...more });
  const part = (id) => elements.get(id);
  if (part("battery").hidden) {
    return null;
  }
  return {
    said: `${part("battery-name").hidden ? "" : "Battery "}${part("battery-text").textContent}`,
    more: part("battery-more").textContent,
    level: !part("battery-level").hidden,
    marks: [...part("battery").attributes],
  };
};

test("an unknown battery is shown as such, without a level and not as low", () => {
  const charge = null;
  assert.deepEqual(shown({ charge, voltage: null, charging: null }), {
    said: "Battery unknown",
    more: "",
    level: false,
    marks: [],
  });
  assert.deepEqual(shown({ charge, voltage: null, charging: true }), {
    said: "Battery unknown",
    more: "charging",
    level: false,
    marks: ["data-charging"],
  });
  assert.deepEqual(shown({ charge: 0.1, voltage: null, charging: false }), {
    said: "Battery 10%",
    more: "",
    level: true,
    marks: ["data-low"],
  });
});

test("the battery of a robot that is silent for seconds is not shown", () => {
  const battery = { charge: 0.5, voltage: null, charging: false };
  assert.notEqual(shown(battery, { robotAt: 98, now: 100 }), null);
  assert.equal(shown(battery, { robotAt: 90, now: 100 }), null);
});

test("a state without a charge is read, and one of an older agent as before", () => {
  const state = (battery) =>
    JSON.stringify({
      stamp: 1,
      boot: "b",
      seq: 1,
      pose: { x: 0, y: 0, theta: 0 },
      velocity: { linear: 0, angular: 0 },
      battery,
    });
  assert.deepEqual(decode("state", state({ charging: null })).battery, {
    charge: null,
    voltage: null,
    charging: null,
  });
  assert.deepEqual(decode("state", state({ charge: 0.5 })).battery, {
    charge: 0.5,
    voltage: null,
    charging: false,
  });
});

test("the replay and the live view show no number for it", () => {
  const column = (value) => [value];
  const states = Object.fromEntries(
    ["t", "x", "y", "theta", "v", "w", "contacts", "docked"].map((name) => [name, column(0)]),
  );
  const record = {
    states: { ...states, localized: [1], charge: [null], clearance: [null] },
    commands: { t: [] },
    network: { t: [] },
    words: [],
  };
  assert.equal(readingsAt(record, 0, { say: (word) => word, has: () => false }).battery, "–");
  assert.equal(
    batteryOf({ battery: { charging: null }, docked: false }, { say: (word) => word }),
    "–",
  );
});
