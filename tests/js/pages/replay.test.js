import assert from "node:assert/strict";
import { test } from "node:test";

import {
  advance,
  newPlayer,
  pressed,
  seek,
  setSpeed,
  SPEEDS,
  toggle,
} from "../../../static/js/pages/replay/player.js";
import {
  commandAt,
  lastBefore,
  momentAt,
  networkAt,
  piecesOf,
} from "../../../static/js/pages/replay/record.js";
import { drawStrips, scaleEnd, stretches } from "../../../static/js/pages/replay/strips.js";
import {
  AXIS,
  asked,
  clamp,
  plotWidth,
  ticks,
  timeAt,
  written,
  xOf,
} from "../../../static/js/pages/replay/timeline.js";

const statesOf = (rows) => ({
  t: rows.map(([t]) => t),
  x: rows.map(([, x]) => x),
  y: rows.map(([, , y]) => y),
  theta: rows.map(([, , , theta]) => theta),
  localized: rows.map(([, , , , localized = 1]) => localized),
});

test("the last state before a time is found for every time", () => {
  const times = [0, 0.25, 0.5, 0.5, 3];
  for (const [t, index] of [
    [-1, -1],
    [0, 0],
    [0.2, 0],
    [0.25, 1],
    [0.5, 3],
    [2.9, 3],
    [3, 4],
    [99, 4],
  ]) {
    assert.equal(lastBefore(times, t), index, `${t}`);
  }
  assert.equal(lastBefore([], 1), -1);
});

test("between two states the robot is on the straight line, and takes the shorter turn", () => {
  const moment = momentAt(
    statesOf([
      [0, 0, 0, 3.0],
      [0.25, 0.2, 0.1, -3.0],
    ]),
    0.125,
  );
  assert.ok(Math.abs(moment.x - 0.1) < 1e-9 && Math.abs(moment.y - 0.05) < 1e-9);
  assert.ok(Math.abs(Math.abs(moment.theta) - Math.PI) < 1e-6, `${moment.theta}`);
});

test("without states the robot stays at its last position, marked as stale", () => {
  const states = statesOf([
    [0, 0, 0, 0],
    [10, 4, 0, 0],
  ]);
  assert.deepEqual([momentAt(states, 1).x, momentAt(states, 1).stale], [0, false]);
  assert.deepEqual([momentAt(states, 5).x, momentAt(states, 5).stale], [0, true]);
  assert.deepEqual([momentAt(states, 10).x, momentAt(states, 99).x], [4, 4]);
  assert.equal(momentAt(statesOf([]), 5), null);
});

test("a robot that was localized somewhere else is not drawn in between", () => {
  const states = statesOf([
    [0, 0, 0, 0],
    [0.25, 0.1, 0, 0],
    [0.5, 5, 5, 0],
    [0.75, 5.1, 5, 0],
    [1, 5.2, 5, 0, 0],
  ]);
  assert.deepEqual(piecesOf(states), [
    [0, 1],
    [2, 3],
  ]);
  assert.equal(momentAt(states, 0.4).x, 0.1);
  assert.deepEqual(piecesOf(statesOf([])), []);
});

test("a command is in force for half a second, a network sample for three", () => {
  const record = {
    commands: { t: [1], v: [0.3], w: [0], method: [0], way: [1], age: [0.05] },
    words: ["touch", "mqtt"],
    network: { t: [1], roundTrip: [0.1], loss: [null] },
  };
  assert.deepEqual(commandAt(record, 1.4), {
    v: 0.3,
    w: 0,
    method: "touch",
    way: "mqtt",
    age: 0.05,
  });
  assert.equal(commandAt(record, 1.6), null);
  assert.equal(commandAt(record, 0.9), null);
  assert.equal(networkAt(record, 3.9).roundTrip, 0.1);
  assert.equal(networkAt(record, 4.1), null);
});

test("pixels and seconds convert both ways, within the time line", () => {
  for (const t of [0, 12.5, 600]) {
    assert.ok(Math.abs(timeAt(xOf(t, 600, 358), 600, 358) - t) < 1e-9);
  }
  assert.deepEqual(
    [timeAt(-20, 600, 358), timeAt(400, 600, 358), timeAt(5, 600, 0), xOf(5, 0, 358)],
    [0, 600, 0, 0],
  );
  assert.deepEqual([clamp(NaN, 10), clamp(Infinity, 10), clamp(-1, 10)], [0, 0, 0]);
});

test("the labels of ticks do not touch", () => {
  for (const [duration, width] of [
    [600, 358],
    [600, 1200],
    [7, 300],
    [7200, 358],
    [0, 358],
    [600, 0],
  ]) {
    const found = ticks(duration, width);
    assert.equal(found[0], 0);
    assert.ok(found.at(-1) <= duration);
    if (found.length > 1 && width) {
      assert.ok(xOf(found[1], duration, width) >= 64);
    }
  }
});

test("a time is written in minutes and seconds", () => {
  assert.deepEqual(
    [written(0), written(59.999), written(125.36), written(125.36, true), written(3600, true)],
    ["0:00", "0:59", "2:05", "2:05.3", "60:00.0"],
  );
});

test("an address selects a time within the session", () => {
  assert.deepEqual(
    ["?t=12.5", "?t=9999", "?t=-3", "?t=soon", ""].map((search) => asked(search, 600)),
    [12.5, 600, 0, 0, 0],
  );
});

test("playing stops at the end, and starts again from the beginning", () => {
  let player = toggle(newPlayer(10));
  player = advance(setSpeed(player, 4), 2);
  assert.deepEqual([player.t, player.playing], [8, true]);
  player = advance(player, 2);
  assert.deepEqual([player.t, player.playing], [10, false]);
  assert.equal(advance(player, 5).t, 10);
  assert.deepEqual([toggle(player).t, toggle(player).playing], [0, true]);
  assert.equal(toggle(newPlayer(0)).playing, false);
});

test("time never runs backwards while it plays", () => {
  assert.equal(advance(toggle(newPlayer(10, 5)), -1).t, 5);
});

test("keys seek, play, and change the speed within its bounds", () => {
  const player = newPlayer(100, 50);
  assert.equal(pressed(player, "ArrowRight", false).t, 51);
  assert.equal(pressed(player, "ArrowLeft", true).t, 40);
  assert.deepEqual([pressed(player, "Home", false).t, pressed(player, "End", false).t], [0, 100]);
  assert.equal(pressed(player, " ", false).playing, true);
  assert.equal(pressed(player, "x", false), player);
  assert.equal(pressed(setSpeed(player, 16), "+", false).speed, SPEEDS.at(-1));
  assert.equal(pressed(player, "-", false).speed, 0.5);
  assert.equal(seek(player, 1e9).t, 100);
});

test("commands with one input method are one stretch, until a pause or another method", () => {
  const t = [0, 0.1, 0.2, 0.5, 0.6, 0.65];
  assert.deepEqual(
    stretches({ t, method: [0, 0, 0, 0, 1, 1] }).map((one) =>
      one.map((value) => Number(value.toFixed(2))),
    ),
    [
      [0, 0.32, 0],
      [0.5, 0.62, 0],
      [0.6, 0.77, 1],
    ],
  );
  assert.deepEqual(stretches({ t: [], method: [] }), []);
});

test("a scale ends at a round number that includes its values", () => {
  for (const [least, end] of [
    [0.5, 0.5],
    [0.51, 1],
    [1.2, 2],
    [100, 100],
    [130, 200],
    [201, 500],
    [600, 1000],
  ]) {
    assert.equal(scaleEnd(least), end, `${least}`);
  }
});

test("each strip has an axis with its unit, and lines between the axes", () => {
  const texts = [];
  const context = new Proxy(
    {
      fillText: (text, x) => texts.push([text, x]),
      measureText: (text) => ({ width: 6 * text.length }),
    },
    { get: (target, name) => target[name] ?? (() => {}), set: () => true },
  );
  const canvas = { clientWidth: 600, style: {}, getContext: () => context, append: () => {} };
  globalThis.document = { createElement: () => ({ style: {}, remove: () => {} }) };
  globalThis.devicePixelRatio = 1;
  globalThis.getComputedStyle = () => ({ fontFamily: "sans", color: "black" });
  const record = {
    duration: 60,
    events: [],
    states: { t: [0, 1], v: [0, 0.3] },
    commands: { t: [], method: [] },
    words: [],
    network: { t: [0, 1], fps: [30, 30], roundTrip: [0.12, 0.13], loss: [0, 0.02] },
  };
  drawStrips(
    canvas,
    record,
    {
      speed: "speed",
      trip: "round trip",
      fps: "frames/s",
      loss: "packet loss",
      method: (name) => name,
    },
    new Set(),
  );
  const width = plotWidth(600);
  assert.equal(width, 600 - 2 * AXIS);
  const of = (text) => texts.find(([told]) => told === text)?.[1];
  for (const text of ["0.5 m/s", "−0.5", "200 ms", "20 %"]) {
    assert.ok(of(text) < 0, text);
  }
  assert.ok(of("40 1/s") > width);
  const whole = parseInt(canvas.style.blockSize, 10);
  texts.length = 0;
  const blinded = { ...record, network: { t: [], fps: [], roundTrip: [], loss: [] } };
  drawStrips(
    canvas,
    blinded,
    {
      speed: "speed",
      trip: "round trip",
      fps: "frames/s",
      loss: "packet loss",
      method: (name) => name,
    },
    new Set(),
  );
  assert.ok(of("0.5 m/s") < 0);
  assert.equal(of("packet loss"), undefined, "who is blind to the network has no strip of it");
  assert.ok(parseInt(canvas.style.blockSize, 10) < whole);
});
