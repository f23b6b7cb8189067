import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { describe, test } from "node:test";

import { newVisit, reduce } from "../../../static/js/protocol/session.js";
import { leavesByItself } from "../../../static/js/autonomy/arrival.js";
import { Aiming, headingOf } from "../../../static/js/input/aiming.js";
import { alertFor } from "../../../static/js/view/hud/alert.js";
import {
  HOLD_SECONDS,
  HeldHelp,
  NO_HELP,
  assistIn,
  helpFrom,
  sideOf,
  wordOf,
} from "../../../static/js/autonomy/assistance.js";
import { cardFor } from "../../../static/js/view/hud/card.js";
import {
  aimsAtStation,
  hintFor,
  menuFor,
  showsLaser,
} from "../../../static/js/autonomy/map_bar.js";
import { offerFor } from "../../../static/js/autonomy/offer.js";
import { mayWriteWaiting } from "../../../static/js/protocol/capabilities.js";
import { reasonFor } from "../../../static/js/autonomy/reasons.js";
import { ellipseOf, scanPoints } from "../../../static/js/view/map/layers.js";
import { newState } from "../../../static/js/drive/features.js";
import {
  AGAIN_SECONDS,
  PATIENCE_SECONDS,
  READING_SECONDS,
  ask,
  heard,
  isMoving,
  messageOf,
  pass,
  wishOf,
} from "../../../static/js/protocol/robot_action.js";

const TEMPLATE = readFileSync(
  new URL("../../../templates/sessions/_words.html", import.meta.url),
  "utf8",
);
const KEYS = new Set(Array.from(TEMPLATE.matchAll(/data-word="([^"]+)"/g), ([, key]) => key));
const ALL = ["velocity", "goto", "dock", "undock", "relocalize", "assist", "scan", "localization"];
const robotOf = (more = {}) => ({
  docked: false,
  assist: "off",
  velocity: { linear: 0, angular: 0 },
  pose: { x: 1, y: 2, theta: 0, localized: true },
  safety: { estop: false, inhibited: null, collision: false },
  ...more,
});
const OVER = { session: "s1", stopId: null, isOver: true, since: 10 };
const driving = (more = {}, capabilities = ALL) => ({
  ...newState(),
  playing: true,
  visit: { ...newVisit(), socket: "open", online: true, phase: "driving", link: "live" },
  factsheet: { capabilities },
  robot: robotOf(),
  plan: { places: [{ name: "sofa", title: "Sofa" }] },
  ...more,
});
const news = (status, more = {}) => ({
  actionId: "a",
  status,
  type: "goto",
  reason: "",
  result: {},
  ...more,
});
const going = (more = {}) => ({
  ...ask({ type: "goto", place: "sofa", title: "Sofa" }, "a", 10),
  status: "RUNNING",
  ...more,
});
const close = (actual, expected) =>
  actual.forEach((value, i) =>
    assert.ok(Math.abs(value - expected[i]) < 1e-9, `${actual} is not ${expected}`),
  );

describe("a task", () => {
  test("repeats its request under the same id until the robot answers", () => {
    const task = ask({ type: "undock" }, "a", 10);
    assert.equal(pass(task, 10 + AGAIN_SECONDS / 2).send, false);
    const again = pass(task, 10.1 + AGAIN_SECONDS);
    assert.deepEqual([again.send, again.action.id], [true, "a"]);
    assert.equal(pass(again.action, again.action.sentAt + AGAIN_SECONDS / 2).send, false);
    assert.equal(pass(heard(task, news("WAITING"), 11), 30).send, false);
  });

  test("fails without an answer, and can be requested again", () => {
    const { action: task } = pass(
      ask({ type: "goto", place: "sofa", title: "Sofa" }, "a", 10),
      10.1 + PATIENCE_SECONDS,
    );
    assert.deepEqual([task.status, task.reason], ["FAILED", "no_answer"]);
    assert.deepEqual(wishOf(task), { type: "goto", place: "sofa", title: "Sofa" });
  });

  test("sends the fields of the Robot API, without the title of a place", () => {
    const message = messageOf(going(), { session: "s", epoch: 3 }, 12);
    assert.deepEqual(message, {
      type: "goto",
      actionId: "a",
      stamp: 12,
      session: "s",
      epoch: 3,
      place: "sofa",
    });
  });

  test("takes the robot's progress and reason, within bounds", () => {
    const task = heard(
      going(),
      news("RUNNING", { reason: "backs_off", result: { progress: 1.7 } }),
      12,
    );
    assert.deepEqual([task.progress, task.reason], [1, "backs_off"]);
    assert.equal(heard(task, news("RUNNING"), 13).progress, 1);
  });

  test("survives a refusal at the very start; a later status ends it for good", () => {
    const asked = ask({ type: "undock" }, "a", 10);
    assert.equal(heard(asked, news("FAILED", { reason: "clock_unknown" }), 10.1), asked);
    const ended = heard(going(), news("FAILED", { reason: "no_laser: silent" }), 12);
    assert.equal(ended.status, "FAILED");
    assert.equal(heard(ended, news("RUNNING"), 13), ended);
  });

  test("of another page is ignored, unless the robot does it and this page has none", () => {
    const mine = going();
    assert.equal(heard(mine, news("RUNNING", { actionId: "b" }), 12), mine);
    assert.equal(heard(null, news("FINISHED", { actionId: "b" }), 12), null);
    assert.equal(heard(null, news("RUNNING", { actionId: "b", type: "photo" }), 12), null);
    assert.deepEqual(
      [
        heard(null, news("RUNNING", { actionId: "b" }), 12).id,
        heard(null, news("RUNNING", { actionId: "b" }), 12).status,
      ],
      ["b", "RUNNING"],
    );
  });

  test("is shown for a moment after its end, a failure until the visitor acts", () => {
    const done = heard(going(), news("FINISHED"), 20);
    assert.equal(pass(done, 20 + READING_SECONDS / 2).action, done);
    assert.equal(pass(done, 20.1 + READING_SECONDS).action, null);
    const failed = heard(going(), news("FAILED"), 20);
    assert.equal(pass(failed, 2000).action, failed);
  });

  test("searching for the position does not move the robot", () => {
    assert.equal(isMoving(ask({ type: "relocalize" }, "a", 1)), false);
    assert.equal(isMoving(going()), true);
  });
});

describe("what is offered", () => {
  test("a docked robot offers one thing to do: leave the dock", () => {
    const visit = { ...driving().visit, session: "s1" };
    const offer = offerFor(driving({ visit, arrival: OVER, robot: robotOf({ docked: true }) }));
    assert.deepEqual(
      [offer.word, offer.main.action, offer.other],
      ["dock.here", "undock", undefined],
    );
  });

  test("the robot leaves its dock once for a new visitor, where one may request it", () => {
    const arrival = { session: "s1", stopId: "stop-0", isOver: false, since: 10 };
    const safety = { estop: false, inhibited: null, collision: false, stopId: "stop-0" };
    const docked = { robot: robotOf({ docked: true, safety }) };
    const visit = { ...driving().visit, session: "s1" };
    const arriving = driving({ ...docked, arrival, visit });
    const changed = (more, now = 11) => leavesByItself({ ...arriving, ...more }, now);
    assert.equal(changed({}), true);
    assert.equal(offerFor(arriving), null, "nothing to press");
    assert.equal(changed({ arrival: { ...arrival, session: "s0" } }), null, "of another visit");
    assert.equal(changed({ arrival: OVER }), false, "once a visit");
    const stopped = { ...safety, inhibited: "stopped", stopId: "stop-1" };
    for (const inhibited of ["stopped", null]) {
      const robot = robotOf({ docked: true, safety: { ...stopped, inhibited } });
      assert.equal(changed({ robot }), false, "stopped since the visit started");
    }
    assert.equal(changed({ visit: { ...arriving.visit, returning: true } }), false, "a reload");
    assert.equal(changed({ robot: robotOf() }), null, "it may be docked in a moment");
    assert.equal(changed({ robot: robotOf() }, 15), false, "it is in the room already");
    const drives = robotOf({ velocity: { linear: 0.1, angular: 0 } });
    assert.equal(changed({ robot: drives }), false, "it drives already");
    const pressed = { ...safety, estop: true };
    assert.equal(changed({ robot: robotOf({ docked: true, safety: pressed }) }), false);
    assert.equal(changed({ factsheet: { capabilities: ["velocity"] } }), false);
    for (const [study, leaves] of [
      [{ actions: ["undock"], controllers: null }, true],
      [{ actions: ["tilt"], controllers: null }, false],
      [{ actions: null, controllers: [] }, false], // a hidden operator drives
    ]) {
      assert.equal(changed({ study }), leaves);
    }
    const held = (inhibited) => ({
      robot: robotOf({ docked: true, safety: { ...safety, inhibited } }),
    });
    for (const early of [
      { playing: false },
      { robot: null },
      { factsheet: null },
      held("no_lease"),
      held("stopped"),
    ]) {
      assert.equal(changed(early), null, "not known yet");
    }
    assert.equal(changed({ visit: { ...arriving.visit, phase: "watching" } }), null);
    assert.equal(changed({ ...held("stopped"), arrival: OVER }), false, "stopped later");
  });

  test("a returning visitor counts as such until the next session", () => {
    const granted = (visit, resumed = false) =>
      reduce(visit, {
        type: "session/granted",
        message: { session: "s1", epoch: 1, peer: "p", limits: {}, iceServers: [], resumed },
      }).visit;
    const from = (...happenings) =>
      happenings.reduce((visit, happening) => reduce(visit, happening).visit, newVisit());
    const reloaded = { type: "loaded", session: "s1", now: 1 };
    const queued = { type: "session/queued", message: { session: "s1", place: 1, minutes: 1 } };
    assert.equal(
      granted(from({ type: "loaded", session: null, go: true, now: 1 })).returning,
      false,
    );
    assert.equal(granted(from(reloaded)).returning, true);
    assert.equal(granted(from(reloaded, queued)).returning, false, "the visit begins later");
    assert.equal(granted(newVisit(), true).returning, true);
    assert.equal(granted(from({ type: "take_over" })).returning, true);
    assert.equal(granted(from(reloaded, { type: "drive", now: 2 })).returning, false);
  });

  test("an action that the robot lacks is not offered; the page leaves the dock itself", () => {
    const docked = driving({ robot: robotOf({ docked: true }) }, ["velocity"]);
    const lost = driving({ robot: robotOf({ pose: { localized: false } }) }, ["velocity"]);
    assert.equal(offerFor(lost), null);
    assert.deepEqual(offerFor(docked).main, { action: "back_out", word: "do.undock" });
    assert.deepEqual(offerFor({ ...docked, maneuver: "back" }).main, {
      action: "stop",
      word: "do.cancel_drive",
    });
    assert.deepEqual(menuFor(docked), []);
  });

  test("only the red button is called stop: the other cancels an automatic drive", () => {
    const { action, word } = offerFor(driving({ task: going() })).main;
    assert.deepEqual([action, word], ["stop", "do.cancel_drive"]);
    assert.ok(KEYS.has(word) && !KEYS.has("do.stop"));
  });

  test("a point too near to a wall is refused with the distance that the robot needs", () => {
    const footprint = [
      [0.3, 0.275],
      [0.3, -0.275],
      [-0.3, -0.275],
      [-0.3, 0.275],
    ];
    const refused = driving({
      task: going({ status: "FAILED", reason: "in_wall: (1.0, 2.0)" }),
    });
    assert.equal(offerFor(refused).detail.word, "reason.in_wall");
    const known = { ...refused, factsheet: { ...refused.factsheet, footprint } };
    assert.deepEqual(offerFor(known).detail, { word: "reason.too_close", values: { cm: "28" } });
    assert.ok(KEYS.has("reason.too_close"));
  });

  test("a viewer gets no offers", () => {
    const state = driving({ robot: robotOf({ docked: true }), task: going() });
    const watching = { ...state, visit: { ...state.visit, phase: "watching" } };
    assert.deepEqual([offerFor(watching), menuFor(watching)], [null, []]);
  });

  test("while the robot drives, the panel shows its destination or why it waits", () => {
    const offer = offerFor(driving({ task: going({ progress: 0.4 }) }));
    assert.deepEqual(
      [offer.word, offer.values, offer.progress, offer.main.action, offer.detail.word],
      ["task.place", { place: "Sofa" }, 0.4, "stop", "task.take_over"],
    );
    assert.equal(
      offerFor(driving({ task: going({ reason: "person" }) })).detail.word,
      "reason.person",
    );
  });

  test("a blocked robot shows why, with two buttons", () => {
    const offer = offerFor(
      driving({ task: going({ status: "FAILED", reason: "door_closed: Laboratory door" }) }),
    );
    assert.deepEqual(offer.detail, {
      word: "reason.door_closed",
      values: { what: "Laboratory door" },
    });
    assert.deepEqual([offer.main.action, offer.other.action], ["task_again", "task_dismiss"]);
  });

  test("a key that takes over is confirmed, and so is a stop", () => {
    assert.equal(
      offerFor(driving({ task: going({ status: "CANCELLED", reason: "manual" }) })).word,
      "task.yours",
    );
    assert.equal(
      offerFor(driving({ task: going({ status: "CANCELLED", reason: "stopped" }) })).word,
      "task.stopped",
    );
  });

  test("a lost robot offers two actions until the visitor shows its position", () => {
    const lost = { robot: robotOf({ pose: { localized: false } }) };
    assert.deepEqual(
      [offerFor(driving(lost)).main.action, offerFor(driving(lost)).other.action],
      ["show_pose", "search"],
    );
    assert.equal(alertFor(driving(lost)).word, "alert.lost");
    assert.equal(
      offerFor(driving({ ...lost, aim: { kind: "pose", x: null, y: null, theta: null } })),
      null,
    );
  });

  test("the answer to an input is shown for a while, and before a slow connection", () => {
    const said = { word: "point.short", at: 100, until: 110 };
    assert.equal(offerFor(driving({ said, now: 103 })), null);
    const slow = { said, now: 109, roundTrip: 0.9, releasedAt: 108 };
    assert.equal(alertFor(driving(slow)).word, "point.short");
    assert.equal(alertFor(driving({ ...slow, now: 111 })).word, "alert.slow");
    const barred = { method: "mouse", at: 99 };
    assert.equal(alertFor(driving({ said, barred, now: 101 })).word, "point.short");
    barred.at = 101;
    assert.equal(alertFor(driving({ said, barred, now: 102 })).word, "off.mouse");
  });

  test("an action that ends beside its goal says why", () => {
    const task = { ...ask({ type: "goto", x: 1, y: 2 }, "a1", 1), status: "FINISHED" };
    assert.equal(offerFor(driving({ task })).detail, null);
    const beside = offerFor(driving({ task: { ...task, reason: "goal_taken: 0.4 m" } }));
    assert.deepEqual([beside.word, beside.detail.word], ["task.done.goto", "reason.goal_taken"]);
  });

  test("entries that are no destination are set apart in the menu", () => {
    const aside = menuFor(driving()).filter((entry) => entry.aside);
    assert.deepEqual(
      aside.map(({ action }) => action),
      ["show_pose", "laser"],
    );
  });

  test("the menu has the places, the dock and the laser points", () => {
    assert.deepEqual(
      menuFor(driving()).map(({ action }) => action),
      ["go_home", "go_to:sofa", "show_pose", "laser"],
    );
    assert.deepEqual(
      menuFor(driving({ robot: robotOf({ docked: true }) }))
        .map(({ action }) => action)
        .includes("go_home"),
      false,
    );
  });

  test("laser points are shown while the robot assists, unless switched off", () => {
    const shows = (assist, laser) => showsLaser(driving({ laser, robot: robotOf({ assist }) }));
    assert.deepEqual(
      [shows("off", null), shows("slow", null), shows("slow", false), shows("off", true)],
      [false, true, false, true],
    );
  });

  test("every offer has its sentences", () => {
    const types = ["goto", "follow", "dock", "undock", "relocalize"];
    const tasks = types.flatMap((type) =>
      ["", "Sofa"].flatMap((title) =>
        ["ASKED", "RUNNING", "FINISHED", "FAILED", "CANCELLED"].map((status) =>
          going({ type, title, status }),
        ),
      ),
    );
    const offers = [
      ...tasks.map((task) => offerFor(driving({ task }))),
      offerFor(driving({ robot: robotOf({ docked: true }) })),
      offerFor(driving({ robot: robotOf({ pose: { localized: false } }) })),
    ];
    const keys = offers
      .flatMap(({ word, detail, main, other }) => [word, detail?.word, main?.word, other?.word])
      .filter(Boolean);
    const menu = menuFor(driving()).flatMap(({ word }) => word ?? []);
    assert.deepEqual(
      [...keys, ...menu].filter((key) => !KEYS.has(key)),
      [],
    );
  });
});

describe("reasons", () => {
  for (const [reason, word, values] of [
    ["boxed_in", "reason.boxed_in", { what: "" }],
    ["door_closed: Lab: door 2", "reason.door_closed", { what: "Lab: door 2" }],
    ["too_fast", "reason.too_fast", { what: "" }],
    ["no_answer", "reason.no_answer", { what: "" }],
    // of an older agent, and of another adapter
    ["the laser is silent.", "reason.other", { what: "the laser is silent" }],
    ["blocked: Lab is closed", "reason.other", { what: "blocked: Lab is closed" }],
    // of a newer agent, and without a sentence
    ["shelf_in_the_way: Kitchen", "reason.other", { what: "shelf in the way: Kitchen" }],
    ["too_many", "reason.other", { what: "too many" }],
    ["constructor", "reason.other", { what: "constructor" }],
  ]) {
    test(`${reason} is shown by ${word}`, () =>
      assert.deepEqual(reasonFor(reason), { word, values }));
  }

  test("an empty reason is none", () => assert.equal(reasonFor(""), null));
});

describe("assistance", () => {
  test("a point is ahead, left, right or behind of the robot", () => {
    assert.deepEqual(
      [
        [1, 0.2],
        [0.1, 0.5],
        [0.1, -0.5],
        [-1, 0.1],
        [-1, -0.1],
      ].map(sideOf),
      ["ahead", "left", "right", "behind", "behind"],
    );
    assert.equal(sideOf(null), "");
  });

  test("an unknown reason of a newer robot is not shown", () =>
    assert.equal(helpFrom("dance", [1, 0]), NO_HELP));

  test("each reason has a sentence for each side", () => {
    const points = [null, [1, 0], [0, 1], [0, -1], [-1, 0]];
    const words = ["slow", "stop", "steer", "blind"].flatMap((why) =>
      points.map((point) => wordOf(helpFrom(why, point))),
    );
    assert.deepEqual(
      words.filter((word) => !KEYS.has(word)),
      [],
    );
    assert.equal(wordOf(NO_HELP), "");
  });

  test("a reason is shown at once, and one that flickers stays", () => {
    const held = new HeldHelp();
    assert.equal(held.hear(helpFrom("slow", [1, 0]), 10).why, "slow");
    const shown = Array.from(
      { length: 20 },
      (_, i) =>
        held.hear(i % 2 ? helpFrom("slow", [1, 0]) : helpFrom("steer", [0, 1]), 10.1 + i / 10).why,
    );
    assert.deepEqual(new Set(shown), new Set(["slow"]));
  });

  test("another reason, or none, replaces it after half a second", () => {
    const held = new HeldHelp();
    held.hear(helpFrom("slow", [1, 0]), 10);
    assert.equal(held.hear(helpFrom("stop", [1, 0]), 10.1).why, "slow");
    assert.equal(held.hear(helpFrom("stop", [1, 0]), 10.05 + HOLD_SECONDS).why, "stop");
    assert.equal(held.hear(NO_HELP, 10.2 + HOLD_SECONDS).why, "stop");
    assert.equal(held.hear(NO_HELP, 10.1 + 2 * HOLD_SECONDS).why, "");
  });

  test("a robot that falls silent does not leave a reason on the page", () => {
    const held = new HeldHelp();
    held.hear(helpFrom("stop", [1, 0]), 10);
    assert.equal(held.tick(10.2).why, "stop");
    assert.equal(held.tick(12).why, "");
  });

  test("the alert explains assistance after more urgent alerts", () => {
    const help = helpFrom("stop", [0.1, 0.4]);
    assert.equal(alertFor(driving({ help })).word, "assist.stop.left");
    assert.equal(
      alertFor(driving({ help, robot: robotOf({ safety: { estop: true } }) })).word,
      "alert.estop",
    );
  });

  test("a robot that moves although it should be at rest is the first alert", () => {
    const errors = ["runs_on: the robot keeps moving", "cancel: no answer"];
    const robot = robotOf({ errors, safety: { estop: true } });
    assert.deepEqual(
      [alertFor(driving({ robot })).word, alertFor(driving({ robot })).tone],
      ["alert.runs_on", "danger"],
    );
    assert.equal(
      alertFor(driving({ robot: robotOf({ errors: errors.slice(1) }) })).word,
      "alert.cancel",
    );
  });

  test("a robot that may still move is not shown as stopped", () => {
    const task = { ...ask({ type: "goto", x: 1, y: 2 }, "a", 1), status: "FAILED" };
    assert.equal(offerFor(driving({ task })).word, "task.failed.goto");
    for (const error of ["runs_on: the robot keeps moving", "cancel: no answer"]) {
      assert.equal(offerFor(driving({ task, robot: robotOf({ errors: [error] }) })), null);
    }
    const going = { ...task, status: "RUNNING" };
    const robot = robotOf({ errors: ["runs_on: the robot keeps moving"] });
    assert.equal(offerFor(driving({ task: going, robot })).main.action, "stop");
  });
});

describe("the level of assistance that is shown", () => {
  const visit = (more) => ({ ...driving().visit, session: "s1", ...more });
  const of = (session, assist) => robotOf({ session, assist });

  test("is the one that the robot reports for this session", () => {
    assert.equal(assistIn(driving({ visit: visit(), robot: of("s1", "slow") })), "slow");
    assert.equal(assistIn(driving({ visit: visit(), robot: of("s1", "off") })), "off");
  });

  test("stays the last one of the session while the robot is offline", () => {
    const assistKnown = { session: "s1", level: "slow" };
    for (const robot of [of(null, "off"), of("s0", "off"), null]) {
      assert.equal(
        assistIn(driving({ visit: visit({ link: "lost" }), robot, assistKnown })),
        "slow",
      );
    }
  });

  test("is none while unknown, and never shown as off", () => {
    assert.equal(assistIn(driving({ visit: visit(), robot: of(null, "off") })), "");
    const former = { session: "s0", level: "steer" };
    assert.equal(assistIn(driving({ visit: visit(), robot: null, assistKnown: former })), "");
    const away = visit({ phase: "watching", online: false });
    assert.equal(assistIn(driving({ visit: away, robot: of(null, "off") })), "");
  });

  test("is the same before, during and after a drive, whatever the owner's level is", () => {
    const assistUsual = "slow";
    for (const phase of ["lobby", "taking", "ended"]) {
      const idle = { visit: visit({ phase, session: null, online: true }), assistUsual };
      assert.equal(assistIn(driving({ ...idle, robot: of(null, "off") })), "slow", phase);
    }
    const watching = visit({ phase: "watching", online: true });
    const robot = of("s2", "steer");
    assert.equal(assistIn(driving({ visit: watching, robot, assistUsual })), "steer");
  });

  test("keeps laser points as they were while the robot is offline", () => {
    const assistKnown = { session: "s1", level: "slow" };
    const lost = driving({ visit: visit({ link: "lost" }), robot: of(null, "off"), assistKnown });
    assert.equal(showsLaser(lost), true);
  });
});

describe("the hint at a point of the map", () => {
  const hint = (aim, hasAimed) => hintFor({ ...driving(), aim, hasAimed });
  const goal = { kind: "goal", x: 1, y: 2, theta: null };

  test("disappears after the first use, as it covers the map", () => {
    assert.equal(hint(goal, false).word, "aim.goal");
    assert.equal(hint({ ...goal, kind: "pose" }, false).word, "aim.pose");
    assert.equal(hint(goal, true), null);
    assert.equal(hint(null, false), null);
  });

  test("stays while the page asks for the position", () => {
    const aim = { kind: "pose", x: null, y: null, theta: null };
    assert.equal(hint(aim, true).word, "aim.pose_first");
  });

  test("says why the robot has no route to the point, or that it ends beside it", () => {
    const of = (points, reason) =>
      hintFor({ ...driving(), aim: goal, hasAimed: true, aimRoute: { points, reason } })?.word;
    assert.equal(of([], "in_wall"), "reason.in_wall");
    assert.equal(
      of(
        [
          [0, 0],
          [1, 1.5],
        ],
        "in_wall",
      ),
      "point.beside",
    );
    assert.equal(
      of(
        [
          [0, 0],
          [1, 2],
        ],
        "",
      ),
      undefined,
    );
  });

  test("a point at the robot's own station means to dock", () => {
    const plan = { docks: [{ type: "giraff", x: 1.2, y: 2 }] };
    const factsheet = { ...driving().factsheet, series: "Giraff" };
    assert.equal(aimsAtStation({ ...driving(), plan, factsheet, aim: goal }), true);
    assert.equal(aimsAtStation({ ...driving(), plan, factsheet, aim: { ...goal, x: 2 } }), false);
    assert.equal(aimsAtStation({ ...driving(), plan: null, factsheet, aim: goal }), false);
  });
});

describe("at the dock", () => {
  test("pressing forward shows a hint for a moment", () => {
    const robot = robotOf({ docked: true });
    assert.equal(
      alertFor(driving({ robot, now: 101, pushedAt: 100 })).word,
      "alert.docked_forward",
    );
    assert.equal(alertFor(driving({ robot, now: 110, pushedAt: 100 })), null);
    assert.equal(alertFor(driving({ now: 101, pushedAt: 100 })), null);
  });
});

describe("writing to the people at a stopped robot", () => {
  const waiting = (visit = {}, more = {}) => ({
    ...driving({ robot: robotOf({ screens: 1 }), ...more }, [...ALL, "say"]),
    factsheet: { capabilities: ["say"] },
    ...more,
    visit: { ...newVisit(), phase: "queued", place: 1, pause: "paused: estop", ...visit },
  });

  test("is for the first in the queue, if the robot has a display", () => {
    assert.equal(mayWriteWaiting(waiting()), true);
    for (const other of [
      waiting({ place: 2 }),
      waiting({ pause: "paused: fault" }),
      waiting({ pause: "" }),
      waiting({ phase: "lobby" }),
      waiting({}, { robot: robotOf({ screens: 0 }) }),
      waiting({}, { robot: null }),
      waiting({}, { study: { actions: null } }),
      waiting({}, { factsheet: { capabilities: [] } }),
    ]) {
      assert.equal(mayWriteWaiting(other), false);
    }
  });
});

describe("the queue of a robot that is not ready", () => {
  const card = (reason, place = 1) => {
    const { visit } = reduce(
      { ...newVisit(), socket: "open", phase: "taking" },
      { type: "session/queued", message: { session: "s", place, minutes: 2, reason } },
    );
    return cardFor({ ...newState(), visit });
  };

  test("the page shows first what the robot is doing", () => {
    assert.deepEqual(
      ["returning: dock", "charging: charging", "returning: offline", "paused: estop", ""].map(
        (reason) => card(reason).word,
      ),
      [...["queued.returning", "queued.charging", "queued.offline", "queued.estop", "queued.next"]],
    );
    assert.equal(card("returning: dock", 3).values.place, 3);
  });

  test("says why the robot did not get home", () => {
    const { word, detail } = card("paused: door_closed: Laboratory door");
    assert.deepEqual(
      [word, detail],
      ["queued.paused", { word: "reason.door_closed", values: { what: "Laboratory door" } }],
    );
  });

  test("the page shows that a docked robot is checked, and the result", () => {
    assert.deepEqual(
      ["picture", "network", "level", "relocalize"].map(
        (reason) => card(`returning: ${reason}`).word,
      ),
      Array(4).fill("queued.checked"),
    );
    const reasons = ["no_picture", "network", "not_connected: no answer"];
    const unfit = reasons.map((reason) => card(`paused: ${reason}`));
    assert.deepEqual(
      unfit.map(({ word, detail }) => [word, detail.word]),
      [
        ["queued.unfit", "reason.no_picture"],
        ["queued.unfit", "reason.network"],
        ["queued.unfit", "reason.not_connected"],
      ],
    );
  });

  test("the page shows which condition of the study is not met", () => {
    const reasons = ["not_docked", "elsewhere", "lost", "charge", "silent"];
    assert.deepEqual(
      reasons.map((reason) => card(`start: ${reason}`).word),
      reasons.map((reason) => `queued.start_${reason}`),
    );
    assert.equal(card("start: something_newer").word, "queued.start_silent");
    assert.deepEqual(
      reasons
        .flatMap((reason) => [`queued.start_${reason}.title`, `queued.start_${reason}.text`])
        .filter((key) => !KEYS.has(key)),
      [],
    );
  });

  test("every state has its sentences", () => {
    const words = [
      "returning: dock",
      "returning: picture",
      "charging: charging",
      "returning: offline",
      "paused: estop",
      "paused: x",
      "paused: network",
    ].map((reason) => card(reason).word);
    assert.deepEqual(
      words.flatMap((word) => [`${word}.title`, `${word}.text`]).filter((key) => !KEYS.has(key)),
      [],
    );
  });
});

describe("the map", () => {
  test("a drag sets the heading, a tap does not", () => {
    assert.equal(headingOf([10, 10], [14, 12]), null);
    close([headingOf([10, 10], [40, 10]), headingOf([10, 40], [10, 10])], [0, Math.PI / 2]);
  });

  test("a press chooses a point, a drag its heading; a second pointer is ignored", () => {
    const target = new EventTarget();
    const canvas = Object.assign(target, {
      setPointerCapture: () => undefined,
      getBoundingClientRect: () => ({ left: 100, top: 50 }),
    });
    const aims = [];
    const aiming = new Aiming({
      canvas,
      toWorld: (px, py) => [px / 10, py / 10],
      onAim: (...aim) => aims.push(aim),
    });
    const say = (type, pointerId, clientX, clientY) =>
      canvas.dispatchEvent(
        Object.assign(new Event(type), { pointerId, clientX, clientY, button: 0 }),
      );
    say("pointerdown", 1, 150, 80);
    assert.deepEqual(aims, []);
    aiming.enable();
    say("pointerdown", 1, 150, 80);
    say("pointerdown", 2, 300, 300);
    say("pointermove", 2, 300, 300);
    say("pointermove", 1, 190, 80);
    say("pointerup", 1, 190, 80);
    say("pointermove", 1, 300, 300);
    assert.deepEqual(aims, [
      [5, 3, null],
      [5, 3, 0],
    ]);
  });

  test("laser points are seen from the position of the laser", () => {
    const scan = {
      angleMin: -Math.PI / 2,
      angleIncrement: Math.PI / 2,
      rangeMax: 8,
      ranges: [1, 2, null, 8],
    };
    const [right, ahead, ...others] = scanPoints(
      scan,
      { x: 0.5 },
      { x: 1, y: 2, theta: Math.PI / 2 },
    );
    close(right, [2, 2.5]);
    close(ahead, [1, 4.5]);
    assert.deepEqual(others, []);
    close(
      scanPoints(
        { ...scan, angleMin: 0, ranges: [1] },
        { x: 0, y: 0, theta: Math.PI / 2 },
        { x: 0, y: 0, theta: 0 },
      )[0],
      [0, 1],
    );
  });

  test("the ellipse is longer along the greater uncertainty", () => {
    const { along, across, turn } = ellipseOf([0.01, 0, 0, 0.04, 0, 0]);
    close([along, across, Math.abs(turn)], [0.4, 0.2, Math.PI / 2]);
    close([ellipseOf([0.02, 0.01, 0, 0.02, 0, 0]).turn], [Math.PI / 4]);
    assert.equal(ellipseOf(null), null);
    assert.equal(ellipseOf([1e-9, 1e-3, 0, 1e-9, 0, 0]).across, 0);
  });
});

describe("a viewer of a robot that nobody drives", () => {
  const watching = (more = {}, visit = {}) => {
    const state = driving(more);
    return { ...state, visit: { ...state.visit, phase: "watching", mayDrive: true, ...visit } };
  };
  const room = (more) => ({ room: { ...newState().room, ...more } });

  test("is offered to drive it, also after a drive of their own", () => {
    assert.deepEqual(offerFor(watching()).main, { action: "drive", word: "do.drive" });
    assert.ok(KEYS.has(offerFor(watching()).word));
  });

  test("is offered nothing while it is not free, not ready, or not theirs to drive", () => {
    const busy = [{ driver: "Ana" }, { driving: true }, { waiting: 1 }, { pause: "returning" }];
    busy.forEach((one) => assert.equal(offerFor(watching(room(one))), null));
    const stopped = robotOf({ safety: { estop: true, inhibited: "estop", collision: false } });
    assert.equal(offerFor(watching({ robot: stopped })), null);
    assert.equal(offerFor(watching({}, { mayDrive: false })), null);
    assert.equal(offerFor(watching({}, { online: false })), null);
  });
});
