import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { describe, test } from "node:test";

import { newVisit } from "../../../static/js/protocol/session.js";
import { Arbiter } from "../../../static/js/input/arbiter.js";
import { Maneuver } from "../../../static/js/input/maneuver.js";
import { Gamepads } from "../../../static/js/input/gamepad.js";
import { HOLD_SECONDS, Pointing } from "../../../static/js/input/pointing.js";
import {
  BACK_OUT,
  SIDE_TURN,
  backOut,
  lookingAt,
  reach,
  towards,
  turnTo,
  arcTo,
} from "../../../static/js/input/pure_pursuit.js";
import { alertFor } from "../../../static/js/view/hud/alert.js";
import { stuckFor } from "../../../static/js/view/hud/stuck.js";
import { cuesFor } from "../../../static/js/view/overlay/cues.js";
import { along } from "../../../static/js/lib/transforms.js";
import { createWords } from "../../../static/js/lib/words.js";
import { toRead } from "../../../static/js/lib/reading_time.js";
import { newState } from "../../../static/js/drive/features.js";

const WORDS = new Set(
  Array.from(
    readFileSync(
      new URL("../../../templates/sessions/_words.html", import.meta.url),
      "utf8",
    ).matchAll(/data-word="([^"]+)"/g),
    ([, key]) => key,
  ),
);
const FOOTPRINT = [
  [0.32, 0.14],
  [0.18, 0.28],
  [-0.18, 0.28],
  [-0.32, 0.14],
  [-0.32, -0.14],
  [-0.18, -0.28],
  [0.18, -0.28],
  [0.32, -0.14],
];
const FULL = { linear: 0.7, reverse: 0.3, angular: 0.7 };
const LIMITS = { linearBraking: 0.8 };
const HOME = { x: 0, y: 0, theta: 0, tilt: 0, linear: 0, angular: 0, stamp: 0, localized: true };
const wall = (x) => Array.from({ length: 81 }, (_, i) => [x, -2 + i / 20]);

describe("driving to a point", () => {
  for (const goal of [
    [3, 0],
    [3, 1.5],
    [2, -1.6],
    [0.6, 0.2],
    [-1, 2],
  ]) {
    test(`a robot reaches (${goal}) on the shown path and stops there`, () => {
      let place = { ...HOME };
      const shown = arcTo(HOME, goal);
      let far = 0;
      let ticks = 0;
      for (let velocity; (velocity = towards(place, goal, FULL, 0.4)); ticks += 1) {
        assert.ok(ticks < 1200, "it never comes there");
        assert.ok(
          Math.abs(velocity.linear) <= FULL.linear &&
            Math.abs(velocity.angular) <= FULL.angular + 1e-9,
        );
        place = along(place, velocity.linear, velocity.angular, 0.05);
        far = Math.max(
          far,
          Math.min(...shown.map(({ x, y }) => Math.hypot(x - place.x, y - place.y))),
        );
      }
      assert.ok(Math.hypot(place.x - goal[0], place.y - goal[1]) < 0.13);
      assert.ok(far < 0.1, `${far} m beside`);
    });
  }

  test("a press leads to the last free point, and nowhere without room", () => {
    const free = reach(HOME, [3, 0.5], FOOTPRINT, []);
    assert.ok(Math.hypot(free.goal[0] - 3, free.goal[1] - 0.5) < 0.02);
    const short = reach(HOME, [3, 0], FOOTPRINT, wall(2));
    assert.ok(
      short.goal[0] > 1.2 && short.goal[0] < 1.6 && short.sweptPath.blocked,
      `${short.goal}`,
    );
    assert.deepEqual(reach(HOME, [3, 0], FOOTPRINT, wall(0.7)), { no: "close" });
    assert.ok(reach(HOME, [40, 0], FOOTPRINT, []).goal[0] < 8.1, "not to the horizon");
  });

  for (const side of [1, -1]) {
    test(`a press at a side turns on the spot, as far as the video moves (${side})`, () => {
      let place = { ...HOME, x: 2, y: 1, theta: 3 };
      const point = lookingAt(place, side * SIDE_TURN);
      for (let velocity, ticks = 0; (velocity = turnTo(place, point, FULL)); ticks += 1) {
        assert.ok(
          ticks < 200 && velocity.linear === 0 && Math.abs(velocity.angular) <= FULL.angular,
        );
        place = along(place, 0, velocity.angular, 0.05);
      }
      assert.ok(Math.abs(place.theta - 3 - side * SIDE_TURN) < 0.06);
    });
  }

  test("the robot backs out of the dock slowly and no further than needed", () => {
    assert.deepEqual(backOut(HOME, [0, 0], FULL), { linear: -0.15, angular: 0 });
    assert.equal(backOut({ ...HOME, x: -BACK_OUT }, [0, 0], FULL), null);
  });
});

describe("a maneuver", () => {
  const rig = () => {
    const [sent, ends] = [[], []];
    const arbiter = new Arbiter((intent) => sent.push(intent));
    const maneuver = new Maneuver({
      offer: (method, velocity) => {
        arbiter.offer(method, velocity);
        return arbiter.holder === method;
      },
      onEnd: (end, kind) => ends.push([end, kind]),
    });
    const world = (more = {}) => ({
      moment: HOME,
      age: 0,
      full: FULL,
      limits: LIMITS,
      footprint: FOOTPRINT,
      seen: [],
      ...more,
    });
    return { arbiter, maneuver, sent, ends, world };
  };

  test("has the name of the controller that pressed, and ends by itself", () => {
    const { maneuver, sent, ends, world } = rig();
    maneuver.start("goal", [3, 0], "touch", 0);
    maneuver.tick(world(), 0.05);
    assert.deepEqual(sent.at(-1), { linear: 0.7, angular: 0, method: "touch" });
    // As a robot drives: never further than it can between two looks.
    for (let x = 0; x <= 2.95; x += 0.05) {
      maneuver.tick(world({ moment: { ...HOME, x } }), x);
    }
    assert.deepEqual(ends, [["there", "goal"]]);
    assert.deepEqual(sent.at(-1), { linear: 0, angular: 0, method: "touch" });
  });

  test("turns where there is no room to drive", () => {
    const { maneuver, sent, ends, world } = rig();
    maneuver.start("turn", lookingAt(HOME, SIDE_TURN), "mouse", 0);
    maneuver.tick(world({ seen: wall(0.4) }), 0.05);
    assert.deepEqual(sent.at(-1), { linear: 0, angular: SIDE_TURN, method: "mouse" });
    maneuver.tick(world({ moment: { ...HOME, theta: SIDE_TURN } }), 0.1);
    assert.deepEqual([ends, sent.at(-1).angular], [[["there", "turn"]], 0]);
  });

  test("ends when a newer controller steers, and can be started again", () => {
    const { arbiter, maneuver, ends, world, sent } = rig();
    maneuver.start("goal", [3, 0], "mouse", 0);
    maneuver.tick(world(), 0);
    arbiter.offer("stick", { linear: 0, angular: 0.4 });
    maneuver.tick(world(), 0.05);
    assert.deepEqual(ends, [["taken", "goal"]]);
    assert.equal(sent.at(-1).method, "stick");
    maneuver.start("goal", [3, 0], "mouse", 1);
    maneuver.tick(world(), 1);
    assert.equal(sent.at(-1).method, "mouse");
  });

  test("ends before an obstacle, without progress, or without poses", () => {
    for (const [more, at, end] of [
      [{ seen: wall(0.6) }, 0.1, "blocked"],
      [{}, 4, "stuck"],
      [{ age: 1 }, 0.1, "lost"],
      [{ moment: null }, 0.1, "lost"],
    ]) {
      const { maneuver, ends, world, sent } = rig();
      maneuver.start("goal", [3, 0], "mouse", 0);
      maneuver.tick(world(), 0);
      maneuver.tick(world(more), at);
      assert.deepEqual(ends, [[end, "goal"]]);
      assert.equal(sent.at(-1).linear, 0);
    }
  });

  test("ends when the robot is localized somewhere else", () => {
    const { maneuver, ends, world } = rig();
    maneuver.start("back", [0, 0], "keyboard", 0);
    maneuver.tick(world(), 0);
    maneuver.tick(world({ moment: { ...HOME, x: 5 } }), 0.1);
    assert.deepEqual(ends, [["lost", "back"]]);
  });

  test("ends at every release, and a disabled controller stops the robot", () => {
    const { maneuver, sent, world } = rig();
    maneuver.start("goal", [3, 0], "mouse", 0);
    maneuver.tick(world(), 0);
    maneuver.disable();
    assert.deepEqual([maneuver.now, sent.at(-1).linear], [null, 0]);
  });
});

describe("pressing on the video", () => {
  const rig = (allowed = () => true, drives = true) => {
    const listeners = new Map();
    const stage = {
      addEventListener: (name, listener) => listeners.set(name, listener),
      removeEventListener: (name) => listeners.delete(name),
      setPointerCapture: () => undefined,
      getBoundingClientRect: () => ({ left: 10, top: 20 }),
    };
    const said = [];
    const clock = { ms: 0 };
    const note = (name) => (what) =>
      said.push(
        [name, what?.px ?? what, what?.py, what?.method].filter((one) => one !== undefined),
      );
    const pointing = new Pointing({
      stage,
      allowed,
      now: () => clock.ms,
      onAim: note("aim"),
      onGo: note("go"),
      onHold: (press) => note("hold")(press) > 0 && drives,
      onEnd: note("end"),
      barred: note("barred"),
      stop: () => said.push(["stop"]),
    });
    pointing.enable();
    const send = (name, clientX, clientY, more = {}) =>
      listeners.get(name)?.({
        target: stage,
        button: 0,
        pointerId: 1,
        pointerType: "mouse",
        clientX,
        clientY,
        ...more,
      });
    return { pointing, said, clock, send, listeners };
  };

  test("shows the path, follows a drag, and drives on release", () => {
    const { said, send } = rig();
    send("pointerdown", 110, 220);
    send("pointermove", 160, 220);
    send("pointerup", 160, 220);
    assert.deepEqual(said, [
      ["aim", 100, 200, "mouse"],
      ["aim", 150, 200, "mouse"],
      ["end", false],
      ["go", 150, 200, "mouse"],
    ]);
  });

  test("drives while it is held still, and no longer", () => {
    const { pointing, said, send, clock } = rig();
    send("pointerdown", 110, 220, { pointerType: "touch" });
    clock.ms = 1000 * HOLD_SECONDS - 50;
    send("pointermove", 160, 220, { pointerType: "touch" });
    clock.ms += 100;
    pointing.tick();
    assert.equal(
      said.some(([what]) => what === "hold"),
      false,
      "who drags still aims",
    );
    clock.ms += 1000 * HOLD_SECONDS;
    pointing.tick();
    assert.deepEqual(said.at(-1), ["hold", 150, 200, "touch"]);
    send("pointerup", 160, 220, { pointerType: "touch" });
    assert.deepEqual(said.at(-1), ["end", true]);
  });

  test("goes at its release where the robot did not drive while it was held", () => {
    const { pointing, said, send, clock } = rig(undefined, false);
    send("pointerdown", 110, 220);
    clock.ms = 1000 * HOLD_SECONDS + 50;
    pointing.tick();
    send("pointerup", 110, 220);
    assert.deepEqual(
      said.slice(-3).map(([what]) => what),
      ["hold", "end", "go"],
    );
  });

  test("stops at a lost touch or when disabled, and ignores other pointers and buttons", () => {
    const { pointing, said, send, listeners } = rig();
    send("pointerdown", 110, 220);
    send("pointerdown", 10, 20, { pointerId: 2 });
    send("pointercancel", 110, 220);
    assert.deepEqual(said.slice(1), [["end", false], ["stop"]]);
    send("pointerdown", 110, 220, { button: 2 });
    send("pointerdown", 110, 220, { target: { matches: () => false } });
    assert.equal(said.length, 3);
    pointing.disable();
    assert.deepEqual([said.at(-1), listeners.size], [["stop"], 0]);
  });

  test("ends when a key is pressed, until it is pressed again", () => {
    const { pointing, said, send, clock } = rig();
    send("pointerdown", 110, 220);
    clock.ms = 2000 * HOLD_SECONDS;
    pointing.tick();
    pointing.letGo();
    pointing.tick();
    send("pointerup", 110, 220);
    assert.deepEqual(
      said.map(([what]) => what),
      ["aim", "hold", "end"],
    );
  });

  test("a controller that a study excludes is explained", () => {
    const { said, send } = rig((method) => method !== "touch");
    send("pointerdown", 110, 220, { pointerType: "touch" });
    assert.deepEqual(said, [["barred", "touch"]]);
    assert.ok(
      WORDS.has("off.touch") ||
        readFileSync(
          new URL("../../../templates/sessions/_study_words.html", import.meta.url),
          "utf8",
        ).includes("off.touch"),
    );
  });
});

describe("gamepad", () => {
  const pad = (axes = [0, 0, 0, 0], pressed = []) => ({
    index: 0,
    mapping: "standard",
    axes,
    buttons: Array.from({ length: 17 }, (_, i) => ({ pressed: pressed.includes(i) })),
  });
  const rig = () => {
    const target = new EventTarget();
    const [said, frames] = [[], []];
    const there = { pad: null };
    const gamepads = new Gamepads({
      target,
      list: () => [there.pad],
      frame: (callback) => frames.push(callback),
      emit: ({ ahead, left }) => said.push(["drive", ahead, left]),
      stop: () => said.push(["stop"]),
      step: (change) => said.push(["step", change]),
      onPad: ({ there: is, stick }) => said.push(["pad", is, stick]),
    });
    const look = (next) => {
      there.pad = next;
      frames.shift()?.();
    };
    const plug = (name, gamepad) =>
      target.dispatchEvent(Object.assign(new Event(name), { gamepad }));
    return { gamepads, said, look, plug, there };
  };

  test("is found when connected, drives with its left stick, and stops when removed", () => {
    const { gamepads, said, look, plug } = rig();
    gamepads.enable();
    plug("gamepadconnected", pad());
    look(pad());
    look(pad([0, -1, 0, 0]));
    assert.deepEqual(said, [
      ["pad", true, "left"],
      ["drive", 1, 0],
    ]);
    plug("gamepaddisconnected", pad());
    assert.deepEqual(said.slice(2), [["drive", 0, 0], ["stop"], ["pad", false, "left"]]);
  });

  test("drives with the other stick once pressed; buttons stop and choose the speed", () => {
    const { gamepads, said, look, there } = rig();
    there.pad = pad();
    gamepads.enable();
    look(pad());
    look(pad([0, -1, 0, 0], [11]));
    look(pad([0, -1, 0, 0]));
    look(pad([0, -1, 1, 0]));
    assert.deepEqual(said.filter(([what]) => what !== "drive").at(-1), ["pad", true, "right"]);
    assert.deepEqual(said.at(-1), ["drive", 0, -1]);
    look(pad([0, 0, 0, 0], [1, 5]));
    assert.deepEqual(said.slice(-3), [["stop"], ["step", 1], ["drive", 0, 0]]);
  });

  test("a stick that is held during a release must be released first", () => {
    const { gamepads, said, look, there } = rig();
    there.pad = pad();
    gamepads.enable();
    look(pad());
    look(pad([0, -1, 0, 0]));
    gamepads.letGo();
    look(pad([0, -1, 0, 0]));
    assert.deepEqual(said.at(-1), ["drive", 0, 0]);
    look(pad());
    look(pad([0, -1, 0, 0]));
    assert.deepEqual(said.at(-1), ["drive", 1, 0]);
    gamepads.disable();
    assert.deepEqual(said.slice(-2), [["drive", 0, 0], ["stop"]]);
  });
});

describe("a robot that does not move", () => {
  const robot = {
    safety: { estop: false, collision: false, inhibited: null },
    refused: {},
    errors: [],
    docked: false,
    pose: { localized: true },
  };
  const pressing = (more = {}, robotMore = {}) => ({
    ...newState(),
    pressing: { since: 10 },
    playing: true,
    now: 20,
    robot: { ...robot, ...robotMore, safety: { ...robot.safety, ...robotMore.safety } },
    ...more,
    visit: {
      ...newVisit(),
      phase: "driving",
      link: "live",
      online: true,
      socket: "open",
      ...more.visit,
    },
  });
  const why = (state, more = {}) =>
    stuckFor(state, { now: 10.6, heardAt: 10.5, movedAt: 0, ...more })?.word ?? null;

  test("has no reason before half a second, without input, or in motion", () => {
    assert.equal(why(pressing(), { now: 10.4 }), null);
    assert.equal(why(pressing({ pressing: null })), null);
    assert.equal(why(pressing(), { movedAt: 10.5 }), null);
    assert.equal(why(pressing({ visit: { phase: "watching" } })), null);
  });

  const REASONS = [
    ["stuck.stopping", { stopping: true }, {}],
    ["stuck.no_picture", { playing: false }, {}],
    ["stuck.held", {}, { safety: { inhibited: "stopped" } }],
    ["stuck.contact", {}, { safety: { inhibited: "collision" } }],
    ["stuck.settling", {}, { safety: { inhibited: "settling" } }],
    [
      "stuck.never_rests",
      {},
      { safety: { inhibited: "settling" }, errors: ["settling: the robot is never at rest"] },
    ],
    ["stuck.not_yours", {}, { safety: { inhibited: "no_lease" } }],
    ["stuck.late", {}, { refused: { stale: 9, clock_unknown: 1 } }],
    ["stuck.old_picture", {}, { refused: { frame_stale: 3 } }],
    ["stuck.measuring", {}, { refused: { clock_unknown: 3 } }],
    ["stuck.not_allowed", {}, { refused: { not_allowed: 3 } }],
    ["stuck.held", {}, { refused: { stopped: 3 } }],
    ["stuck.not_yours", {}, { refused: { wrong_epoch: 3 } }],
    ["stuck.error", {}, { errors: ["battery empty"] }],
    ["stuck.unheard", {}, { visitorSilence: 1.5 }],
    ["stuck.unknown", {}, { visitorSilence: 0.2 }],
  ];
  for (const [word, more, robotMore] of REASONS) {
    test(`${word.slice(6)}: ${JSON.stringify({ ...more, ...robotMore })}`, () => {
      const state = pressing(more, robotMore);
      assert.equal(why(state), word);
      assert.ok(WORDS.has(word));
      const stuck = stuckFor(state, { now: 10.6, heardAt: 10.5, movedAt: 0 });
      assert.equal(alertFor({ ...state, playing: true, stuck }).word, word);
    });
  }

  test("silent: no message for a second", () => {
    assert.equal(why(pressing(), { now: 12, heardAt: 10.5 }), "stuck.silent");
  });

  test("other alerts come first, and slow connections do not hide the reason", () => {
    const stuck = { word: "stuck.late" };
    assert.equal(alertFor(pressing({ stuck }, { safety: { estop: true } })).word, "alert.estop");
    assert.equal(
      alertFor(pressing({ stuck }, { safety: { collision: true } })).word,
      "alert.collision",
    );
    assert.equal(
      alertFor(pressing({ stuck, pushedAt: 19 }, { docked: true })).word,
      "alert.docked_forward",
    );
    assert.equal(alertFor(pressing({ stuck, roundTrip: 2 })).word, "stuck.late");
  });

  test("an answer to a press comes first, for as long as reading takes", () => {
    const said = { word: "point.wall", at: 12, until: 20 };
    assert.equal(alertFor(pressing({ said, now: 19 })).word, "point.wall");
    assert.equal(alertFor(pressing({ said, now: 21 })), null);
    const sentences = createWords(
      new Map([
        ["short", "Go."],
        ["long", "a ".repeat(20).trim()],
      ]),
    );
    const length = (/** @type {string} */ word) => {
      const { at, until } = toRead(sentences, word);
      return until - at;
    };
    assert.ok(length("short") > 4);
    assert.ok(length("long") >= 12);
    const ends = ["sky", "wall", "close", "blocked", "stuck", "lost"].map((end) => `point.${end}`);
    assert.deepEqual(
      [...ends, "pad.left", "pad.right", "pad.gone", "pad.unknown"].filter(
        (word) => !WORDS.has(word),
      ),
      [],
    );
  });
});

describe("cues in the video", () => {
  const plan = {
    walls: [{ start: [2, -5], end: [2, 5] }],
    docks: [
      { type: "giraff", x: 1, y: 0, theta: 0 },
      { type: "rhodon", x: 1, y: 1, theta: 0 },
    ],
  };
  const study = {
    kind: "task",
    checkpoints: [
      { number: 0, title: "", radius: 0.6 },
      { number: 2, title: "", radius: 0.5 },
    ],
  };
  const progress = {
    cue: "go_to_checkpoint",
    number: 2,
    x: 4,
    y: 0,
    outcome: "",
    window: "shut",
    passed: [],
  };

  test("mark the target of the task, also behind walls, or else a visible dock", () => {
    assert.deepEqual(cuesFor({ ...newState(), plan, study, progress }, HOME), [
      { point: [4, 0], radius: 0.5, sign: "2", hidden: true },
    ]);
    const free = { ...newState(), plan, factsheet: { series: "Giraff" } };
    assert.deepEqual(cuesFor(free, HOME), [
      { point: [1, 0], radius: 0.3, sign: "", hidden: false },
    ]);
    assert.deepEqual(cuesFor(free, { ...HOME, x: 3 }), []);
    assert.deepEqual(cuesFor({ ...free, robot: { docked: true } }, HOME), []);
    assert.deepEqual(cuesFor(free, { ...HOME, localized: false }), []);
  });
});
