import assert from "node:assert/strict";
import { readFileSync, readdirSync } from "node:fs";
import { describe, test } from "node:test";

import { offerFor } from "../../../static/js/autonomy/offer.js";
import { isRefusal } from "../../../static/js/protocol/estop_release.js";
import { REASONS } from "../../../static/js/protocol/messages.js";
import { newVisit, reduce } from "../../../static/js/protocol/session.js";
import { alertFor, staysOverCards } from "../../../static/js/view/hud/alert.js";
import { cardFor } from "../../../static/js/view/hud/card.js";
import { clockTime } from "../../../static/js/lib/clock.js";
import { contains, createDials, roomAt } from "../../../static/js/view/map/dials.js";
import { standstillOf } from "../../../static/js/protocol/standstill.js";
import { statusFor } from "../../../static/js/view/hud/status.js";
import { createWords } from "../../../static/js/lib/words.js";
import { freeRobotsIn } from "../../../static/js/waiting/free_robots.js";
import { newState } from "../../../static/js/drive/features.js";
import { odometerAt } from "../../../static/js/drive/session.js";
import { createStore } from "../../../static/js/drive/store.js";

const TEMPLATE = readFileSync(
  new URL("../../../templates/sessions/_words.html", import.meta.url),
  "utf8",
);
const SENTENCES = new Map(
  Array.from(TEMPLATE.matchAll(/data-word="([^"]+)">(.*)<\/p>/g), ([, key, sentence]) => [
    key,
    sentence,
  ]),
);
const ROOT = new URL("../../../static/js/", import.meta.url);

const state = (visit = {}, more = {}) => ({
  ...newState(),
  ...more,
  visit: {
    ...newVisit(),
    socket: "open",
    online: true,
    mayDrive: true,
    mayObserve: true,
    ...visit,
  },
});
const ROBOT = { safety: { estop: false, inhibited: null, collision: false } };
const STANDSTILLS = [
  { safety: { ...ROBOT.safety, estop: true, estopSource: "screen:Giraff" } },
  { safety: { ...ROBOT.safety, estop: true, estopSource: "owner:Ana" } },
  { safety: { ...ROBOT.safety, inhibited: "fault" }, errors: ["adapter_lost: no answer"] },
  { safety: { ...ROBOT.safety, inhibited: "fault" }, errors: ["rival: another agent runs"] },
];
const PHASES = [
  "connecting",
  "lobby",
  "taking",
  "queued",
  "turn",
  "driving",
  "watching",
  "elsewhere",
];
const REFUSED = [
  "offline",
  "disabled",
  "not_invited",
  "not_trained",
  "observers_full",
  "not_allowed",
  "paused",
];
const ENDED = [
  "completed",
  "timed_out",
  "connection_refused",
  "cancelled",
  "stopped_by_operator",
  "robot_fault",
  "connection_lost",
  "moved",
  "left",
  "turn_missed",
  "idle",
];
const CLOSED = ["signed_out", "not_allowed", "no_such_robot", "unsupported", "in_app"];

const ROOM = { driving: true, observers: 0, waiting: 1, pause: "" };
const PRIVATE = { ...ROOM, driver: "", private: true };
/** Why nobody gets a robot between two visits, and how it is called then. */
const BETWEEN = /** @type {[string, string, string][]} */ ([
  ["returning: dock", "status.returning", "returning"],
  ["returning: picture", "status.checked", "checked"],
  ["charging: charging", "status.charging", "charging"],
  ["paused: dock_failed", "status.paused", "paused"],
  ["held: a new carpet", "status.held", "held"],
]);

const free = (pause = "") => ({ driver: null, driving: false, observers: 0, waiting: 0, pause });

const everyState = () => [
  ...PHASES.flatMap((phase) =>
    ["none", "connecting", "live", "lost"].flatMap((link) => [
      state({ phase, link }),
      state({ phase, link, socket: "lost" }),
      state({ phase, link, online: false }),
    ]),
  ),
  state({ phase: "queued", place: 1 }),
  state({ phase: "queued", place: 3 }),
  state({ phase: "lobby", liveElsewhere: true }),
  state({ phase: "lobby", liveElsewhere: true, liveSince: 1e9 }, { elsewhere: "browser" }),
  state({ phase: "elsewhere", liveSince: 1e9 }, { elsewhere: "device" }),
  state({ phase: "elsewhere" }, { takingOver: true }),
  state({ phase: "lobby", mayDrive: false }),
  state({ phase: "lobby" }, { room: PRIVATE }),
  state({ phase: "lobby", mayDrive: false }, { room: PRIVATE }),
  state({ phase: "queued", place: 2 }, { room: PRIVATE }),
  state({ phase: "lobby", mayDrive: false, mayObserve: false }),
  state(
    { phase: "lobby" },
    { room: { driver: "Ana", driving: true, observers: 0, waiting: 0, pause: "" } },
  ),
  state(
    { phase: "lobby" },
    { room: { driver: null, driving: true, observers: 0, waiting: 0, pause: "" } },
  ),
  ...STANDSTILLS.map((robot) => state({ phase: "lobby" }, { robot })),
  ...BETWEEN.flatMap(([pause]) =>
    [true, false].flatMap((docked) => [
      state({ phase: "lobby" }, { room: free(pause), robot: { ...ROBOT, docked } }),
      state({ phase: "queued", pause }, { robot: { ...ROBOT, docked } }),
    ]),
  ),
  ...ENDED.map((reason) =>
    state({ phase: "ended", reason }, { returnsHome: true, robot: { ...ROBOT, docked: false } }),
  ),
  state({ phase: "driving" }, { leaving: true }),
  state({ phase: "driving" }, { leaving: true, returnsHome: true }),
  state(
    { phase: "driving", link: "live", askedUntil: 20 },
    { leaving: true, playing: true, now: 5 },
  ),
  state({ phase: "queued", place: 2 }, { notifiable: true }),
  ...["off", "starting", "on"].map((practice) =>
    state({ phase: "queued", place: 2 }, { practice, notifiable: true }),
  ),
  ...["driving", "watching"].flatMap((phase) =>
    ["connecting", "lost"].map((link) =>
      state({ phase, link }, { slow: true, playing: true, robot: ROBOT }),
    ),
  ),
  ...REFUSED.map((reason) => state({ phase: "refused", reason })),
  ...ENDED.map((reason) => state({ phase: "ended", reason })),
  ...CLOSED.map((reason) => state({ phase: "closed", reason })),
];

describe("cards", () => {
  test("every state of the page has its words, and so has every button", () => {
    for (const one of everyState()) {
      const card = cardFor(one);
      const keys = card
        ? [
            `${card.word}.title`,
            `${card.word}.text`,
            card.main?.word,
            card.extra?.word,
            card.other?.word,
          ]
        : [];
      assert.deepEqual(
        keys.filter((key) => key && !SENTENCES.has(key)),
        [],
        JSON.stringify(one.visit),
      );
      assert.ok(SENTENCES.has(statusFor(one).word));
      assert.ok(!alertFor(one) || SENTENCES.has(alertFor(one).word));
    }
  });

  test("a robot that cannot be driven is not shown as ready, and has a queue", () => {
    const told = STANDSTILLS.map((robot) => {
      const one = state({ phase: "lobby" }, { robot });
      return [cardFor(one).word, cardFor(one).main.word, statusFor(one).word];
    });
    assert.deepEqual(told, [
      ["lobby.estop_there", "do.queue", "status.stopped"],
      ["lobby.estop", "do.queue", "status.stopped"],
      ["lobby.not_connected", "do.queue", "status.fault"],
      ["lobby.fault", "do.queue", "status.fault"],
    ]);
    const well = state({ phase: "lobby" }, { robot: { ...ROBOT, errors: ["lens dirty"] } });
    assert.deepEqual([cardFor(well).word, statusFor(well).word], ["lobby", "status.ready"]);
  });

  test("a robot stopped between sessions shows it, and is released by its next driver", () => {
    const robot = { ...ROBOT, docked: false, safety: { ...ROBOT.safety, inhibited: "stopped" } };
    const told = (more) => {
      const one = state({ phase: "lobby" }, { robot, room: free(""), ...more });
      return [cardFor(one).word, cardFor(one).main.word, statusFor(one).word];
    };
    assert.deepEqual(told({}), ["lobby.stopped", "do.drive", "status.stopped"]);
    const docked = { robot: { ...robot, docked: true } };
    assert.deepEqual(told(docked), ["lobby.stopped", "do.drive", "status.stopped"]);
    const waits = { room: { ...free(""), waiting: 2 } };
    assert.deepEqual(told(waits), ["lobby.waiting", "do.queue", "status.stopped"]);
    const driven = { room: { ...free(""), driver: "Ada" } };
    assert.deepEqual(told(driven).slice(2), ["status.busy"]);
    assert.ok(SENTENCES.has("lobby.stopped.title") && SENTENCES.has("lobby.stopped.text"));
    const operated = (more) =>
      cardFor(state({ phase: "lobby" }, { robot, room: free(""), operates: true, ...more }));
    assert.equal(operated({}).word, "lobby.stopped_operates");
    assert.equal(operated({}).detail, null, "the text says why it is stopped");
    assert.equal(operated({}).extra.action, "release_stop");
    assert.ok(SENTENCES.has("lobby.stopped_operates.text"));
    const refused = operated({ release: { id: "r", since: 0, refused: true } });
    assert.equal(refused.detail.word, "release.held_failed");
    assert.ok(SENTENCES.has("release.held_failed"));
    assert.equal(operated(waits).detail.word, "release.held");
  });

  test("a viewer of a robot stopped between sessions reads who can release it", () => {
    const robot = { ...ROBOT, docked: false, safety: { ...ROBOT.safety, inhibited: "stopped" } };
    const watching = (more) =>
      alertFor(state({ phase: "watching", link: "live" }, { robot, room: free(""), ...more }));
    assert.equal(watching({}).word, "alert.held");
    assert.equal(watching({ operates: true }), null, "the offer to release it says so");
    assert.equal(watching({ room: { ...free(""), driver: "Ada" } }), null);
    assert.ok(SENTENCES.has("alert.held"));
  });

  test("a robot that moves although it should be at rest is not shown as free", () => {
    const robot = { ...ROBOT, errors: ["runs_on: the robot keeps moving"] };
    const one = state({ phase: "lobby" }, { robot, room: free("") });
    assert.deepEqual(
      [cardFor(one).word, statusFor(one).word, statusFor(one).tone],
      ["lobby.runs_on", "status.fault", "danger"],
    );
    assert.ok(SENTENCES.has("lobby.runs_on.title") && SENTENCES.has("lobby.runs_on.text"));
  });

  test("a robot that does not stop is shown before any stop of it, also in the queue", () => {
    const errors = ["runs_on: the robot keeps moving", "adapter_lost: no answer"];
    for (const robot of STANDSTILLS.map((one) => ({ ...one, errors }))) {
      assert.equal(standstillOf(robot), "runs_on");
      const one = state({ phase: "lobby" }, { robot, room: free("") });
      assert.deepEqual([cardFor(one).word, statusFor(one).word], ["lobby.runs_on", "status.fault"]);
      for (const phase of ["queued", "turn"]) {
        const waits = (visit) => alertFor(state({ phase, link: "none", ...visit }, { robot }));
        assert.deepEqual(waits({}), { word: "alert.runs_on", tone: "danger" });
        assert.equal(waits({ socket: "lost" }).word, "alert.server");
        assert.equal(waits({ online: false }), null, "what it said last may be over");
      }
    }
  });

  test("a card shows the part that fails or the denial, whatever the robot's state", () => {
    const faults = [{ part: "broker", then: "stops", at: 110 }];
    const denial = { word: "denied.action", at: 99, until: 108 };
    const card = (visit, more) =>
      cardFor(state({ link: "live", session: "s", ...visit }, { robot: ROBOT, now: 100, ...more }));
    const robots = [
      { safety: { ...ROBOT.safety, collision: true } },
      { ...ROBOT, cameraStatus: { status: "failed", reason: "gone" } },
      ...STANDSTILLS,
    ];
    for (const robot of robots) {
      const waits = (more) => card({ phase: "queued" }, { robot, playing: true, ...more });
      assert.equal(waits({ faults }).warning?.word, "fault.broker.waits");
      assert.equal(waits({ denial }).warning?.word, "denied.action");
      assert.equal(waits({ faults, denial }).warning?.word, "fault.broker.waits");
      assert.equal(waits({}).warning, undefined);
    }
    const leaving = (visit, more = {}) =>
      card({ phase: "driving", ...visit }, { leaving: true, stopUnconfirmed: true, ...more })
        .warning?.word;
    assert.equal(leaving({}, { faults }), "fault.broker.stops");
    assert.equal(leaving({ socket: "lost" }), "alert.server_only");
    assert.equal(leaving({ socket: "lost", link: "lost" }), "alert.server_driver");
    assert.equal(leaving({ online: false, link: "lost", serverBlind: true }), "alert.server");
    assert.equal(leaving({ online: false, link: "lost" }), undefined, "it is not the server");
    const disk = [{ part: "disk_full", then: "goes_on", at: null }];
    assert.equal(leaving({}, { faults: disk }), "fault.disk_full");
  });

  test("an alert that no card shows stays visible over a card", () => {
    for (const word of ["estop", "estop_screen", "runs_on", "stop_unconfirmed"]) {
      assert.ok(staysOverCards(`alert.${word}`) && SENTENCES.has(`alert.${word}`), word);
    }
    assert.ok(!staysOverCards("fault.session_manager.waits"), "the card has a line for it");
    assert.ok(!staysOverCards("alert.turn_ends") && !staysOverCards(""));
  });

  test("a robot between sessions has the same name before, after and while waiting", () => {
    for (const [pause, status, word] of BETWEEN) {
      const more = { room: free(pause), robot: { ...ROBOT, docked: false } };
      const [lobby, left] = [state({ phase: "lobby" }, more), state({ phase: "ended" }, more)];
      assert.deepEqual([statusFor(lobby).word, statusFor(left).word], [status, status]);
      assert.deepEqual(
        [cardFor(lobby).word, cardFor(lobby).main.word],
        [`lobby.${word}`, "do.queue"],
      );
      const queued = cardFor(state({ phase: "queued", pause }, more)).word;
      assert.equal(SENTENCES.get(`${queued}.title`), SENTENCES.get(`lobby.${word}.title`), pause);
    }
    // It is the server that gives the robot to somebody, and it may not know of the release yet.
    const released = state({ phase: "lobby" }, { room: free("paused: estop"), robot: ROBOT });
    assert.equal(statusFor(released).word, "status.paused");
    assert.equal(cardFor(released).main.word, "do.queue");
  });

  test("a visitor who joins a queue at a robot without a driver reads the place", () => {
    const card = cardFor(state({ phase: "lobby" }, { room: { ...free(""), waiting: 2 } }));
    assert.deepEqual(
      [card.word, card.values.place, card.main.word],
      ["lobby.waiting", 3, "do.queue"],
    );
  });

  test("a robot that returns to its dock is not shown as stopped", () => {
    const ended = (reason, docked) =>
      cardFor(state({ phase: "ended", reason }, { returnsHome: true, robot: { ...ROBOT, docked } }))
        .word;
    assert.deepEqual(
      [ended("left", false), ended("left", true), ended("robot_fault", false)],
      ["ended.left_home", "ended.left", "ended.robot_fault"],
    );
    assert.equal(cardFor(state({ phase: "ended", reason: "left" })).word, "ended.left");
  });

  test("a visitor waiting for an undocked robot reads one reason, and free robots", () => {
    const freeRobots = [{ action: "Drive Rhodon", url: "/robots/rhodon/?go=1" }];
    const waits = (reason, docked = false) =>
      cardFor(
        state(
          { phase: "queued", place: 1, pause: `paused: ${reason}` },
          { freeRobots, robot: { ...ROBOT, docked } },
        ),
      );
    const told = [
      ["dock_failed: no_contact", "queued.paused", "reason.dock_failed"],
      ["before_dock", "queued.paused", "because.before_dock"],
      ["not_found", "queued.paused", "because.lost"],
      ["waits_for_route", "queued.paused", "reason.all_blocked"],
      ["tries_again: late", "queued.paused", undefined],
    ];
    for (const [reason, word, detail] of told) {
      const card = waits(reason);
      assert.deepEqual([card.word, card.detail?.word], [word, detail], reason);
      assert.ok(!detail || SENTENCES.has(detail) || REASONS.has(detail.slice(7)), detail);
      assert.ok(!/wait|Drive a little/.test(SENTENCES.get(detail ?? "") ?? ""), detail);
      assert.deepEqual(card.instead, freeRobots);
    }
    assert.equal(waits("not_found", true).word, "queued.unfit");
    const held = cardFor(state({ phase: "queued", place: 1, pause: "held: a new carpet" }));
    assert.deepEqual(held.detail, { word: "because.held", values: { reason: "a new carpet" } });
    assert.ok(SENTENCES.has("because.held"));
  });

  test("only free robots that the visitor may drive are offered instead", () => {
    const list = {
      robots: [
        { name: "giraff", state: "available", drives: true, action: "Drive Giraff", url: "/g" },
        { name: "lent", state: "available", drives: false, action: "Open its page", url: "/l" },
        { name: "taken", state: "busy", drives: true, action: "Join the queue", url: "/t" },
        { name: "rhodon", state: "available", drives: true, action: "Drive Rhodon", url: "/r" },
      ],
    };
    const words = createWords(new Map([["instead.experienced", "{action} (hard)"]]), "en");
    assert.deepEqual(freeRobotsIn(list, "giraff", words), [{ action: "Drive Rhodon", url: "/r" }]);
    list.robots[3].for_experienced = true;
    assert.deepEqual(freeRobotsIn(list, "giraff", words), [
      { action: "Drive Rhodon (hard)", url: "/r" },
    ]);
  });

  test("a simulated robot is never shown as switched off", () => {
    for (const kind of [{ guest: true }, { practising: true }]) {
      const words = [
        state({ phase: "refused", reason: "offline" }, kind),
        state({ phase: "lobby", online: false }, kind),
      ].map((one) => cardFor(one).word);
      assert.deepEqual(words, ["refused.simulated", "refused.simulated"]);
      for (const word of words) {
        assert.ok(SENTENCES.has(`${word}.title`) && SENTENCES.has(`${word}.text`));
      }
    }
    assert.equal(cardFor(state({ phase: "refused", reason: "offline" })).word, "refused.offline");
  });

  test("a simulated robot is requested again, as it does not start by itself", () => {
    const actions = (kind) =>
      [
        state({ phase: "refused", reason: "offline" }, kind),
        state({ phase: "lobby", online: false }, kind),
        ...["idle", "left", "connection_lost", "robot_fault"].map((reason) =>
          state({ phase: "ended", reason }, kind),
        ),
      ].map((one) => cardFor(one).main?.action);
    assert.deepEqual(new Set(actions({ practising: true })), new Set(["practise_again"]));
    assert.deepEqual(actions({ guest: true }).slice(0, 3), [
      "practise_again",
      "practise_again",
      "sign_up",
    ]);
    assert.ok(!actions({}).includes("practise_again"));
  });

  test("a visitor waiting for a robot with a fault reads it and keeps the place", () => {
    for (const [reason, word] of [
      ["fault", "reason.fault"],
      ["not_connected", "reason.not_connected"],
    ]) {
      const card = cardFor(state({ phase: "queued", place: 2, pause: `paused: ${reason}` }));
      assert.deepEqual([card.word, card.detail.word], ["queued.unfit", word]);
    }
    const stopped = cardFor(state({ phase: "queued", place: 2, pause: "paused: estop" }));
    assert.deepEqual([stopped.word, stopped.values.place], ["queued.estop", 2]);
  });

  test("a page that has ended always offers a button", () => {
    for (const one of everyState()) {
      const card = cardFor(one);
      assert.ok(!card || card.busy || card.main || card.other, JSON.stringify(one.visit));
    }
  });

  test("no card covers the video; a lost link has an alert instead", () => {
    assert.equal(cardFor(state({ phase: "driving", link: "live" }, { playing: true })), null);
    const lost = state({ phase: "driving", link: "lost" });
    assert.equal(cardFor(lost), null);
    assert.equal(alertFor(lost).word, "alert.link_driver");
  });

  test("a viewer by the SFU reads that it is down, or has lost the robot", () => {
    const watching = { phase: "watching", link: "lost", online: true, sfu: true };
    assert.equal(
      alertFor(state({ ...watching, sfuLost: true }, { robot: ROBOT })).word,
      "alert.sfu_lost",
    );
    const still = state(
      { ...watching, link: "live" },
      { robot: ROBOT, playing: true, still: true },
    );
    assert.equal(alertFor(still).word, "alert.link_observer");
  });

  test("a guest of a simulated robot is invited to sign up", () => {
    const card = cardFor(state({ phase: "ended", reason: "timed_out" }, { guest: true }));
    assert.deepEqual([card.word, card.main.action], ["ended.guest", "sign_up"]);
  });

  test("a driver may save a picture of the drive, other visitors may not", () => {
    const ended = (reason, changes) =>
      cardFor(state({ phase: "ended", reason }, changes)).extra?.action;
    const trip = { session: "s", metres: 4, minutes: 1, trail: [] };
    assert.equal(ended("left", { trip }), "souvenir");
    assert.equal(ended("left", { trip: null }), undefined);
    assert.equal(ended("left", { trip: { ...trip, metres: 0.1 } }), undefined);
    assert.equal(ended("moved", { trip }), undefined);
    assert.equal(ended("left", { trip, practising: true }), undefined);
    assert.equal(ended("left", { trip, study: { kind: "task", stops: [] } }), undefined);
  });

  test("an unknown outcome of a newer server has a general card", () => {
    const card = cardFor(state({ phase: "ended", reason: "abducted" }));
    assert.deepEqual([card.word, card.main.action], ["ended.completed", "home"]);
  });

  test("a visitor asked for activity has one button and sees the time left", () => {
    const card = cardFor(
      state({ phase: "driving", link: "live", askedUntil: 130 }, { now: 100.2, playing: true }),
    );
    assert.deepEqual(card, {
      word: "idle",
      countdown: 30,
      main: { action: "here", word: "do.here" },
      quiet: true,
    });
  });

  test("a private drive is neither shown nor offered to watch", () => {
    const waits = cardFor(
      state({ phase: "queued", place: 2, mayObserve: true }, { room: PRIVATE }),
    );
    assert.deepEqual(waits?.detail, { word: "private" });
    const comes = cardFor(state({ phase: "lobby", mayObserve: true }, { room: PRIVATE }));
    assert.deepEqual(
      [comes?.word, comes?.detail, comes?.main?.action, comes?.other],
      ["lobby.busy_unnamed", { word: "private" }, "drive", undefined],
    );
    const looks = cardFor(
      state({ phase: "lobby", mayDrive: false, mayObserve: true }, { room: PRIVATE }),
    );
    assert.deepEqual([looks?.word, looks?.main?.action], ["refused.private", "home"]);
  });

  test("a waiting visitor reads who drives, if that is the reason", () => {
    const waits = (pause, driver) =>
      cardFor(state({ phase: "queued", place: 2, pause }, { room: { ...ROOM, driver } })).detail;
    assert.deepEqual(waits("", "Ana"), { word: "queued.driver", values: { driver: "Ana" } });
    assert.ok(SENTENCES.has("queued.driver"));
    assert.equal(waits("", null), null);
    assert.equal(waits("paused: estop", "Ana"), undefined);
  });

  test("a waiting visitor may ask for a notification, while the browser can ask", () => {
    const waits = (notifiable) =>
      cardFor(state({ phase: "queued", place: 2 }, { notifiable })).main?.action;
    assert.deepEqual([waits(true), waits(false)], ["tell_me", undefined]);
  });

  test("a waiting visitor may practise where there is a robot for it", () => {
    const card = (practice) =>
      cardFor(state({ phase: "queued", place: 2 }, { practice, notifiable: true }));
    assert.deepEqual(
      [card("off").main.action, card("off").extra.action, card("none").main.action],
      ["practise", "tell_me", "tell_me"],
    );
    assert.deepEqual(
      [card("starting").busy, card("starting").detail.word, card("starting").main],
      [true, "practice.starting", undefined],
    );
  });

  test("a robot with a driver is shown as in use, with the place in its queue", () => {
    const one = state(
      { phase: "lobby" },
      { room: { driver: "Ana", driving: true, observers: 0, waiting: 2, pause: "" } },
    );
    assert.deepEqual([statusFor(one).word, cardFor(one).values.place], ["status.busy", 3]);
    assert.equal(statusFor(state({ phase: "lobby" })).word, "status.ready");
    for (const phase of ["queued", "turn"]) {
      assert.equal(
        statusFor({
          ...state({ phase, link: "live", online: true, socket: "open" }),
          playing: true,
        }).word,
        "status.waiting",
        "also while they watch",
      );
    }
  });

  test("a turn counts down to zero and not below", () => {
    assert.equal(cardFor(state({ phase: "turn", startBy: 130 }, { now: 100.2 })).countdown, 30);
    assert.equal(cardFor(state({ phase: "turn", startBy: 130 }, { now: 140 })).countdown, 0);
  });
});

describe("alerts", () => {
  test("an unconfirmed stop comes first", () => {
    const one = state({ phase: "driving", link: "lost", online: false }, { stopUnconfirmed: true });
    assert.deepEqual(alertFor(one), { word: "alert.stop_unconfirmed", tone: "danger" });
  });

  test("but not with the emergency stop, whose release is shown, too", () => {
    const robot = { safety: { ...ROBOT.safety, estop: true, estopSource: "screen:hall" } };
    const driving = { phase: "driving", link: "live" };
    const one = state(driving, { stopUnconfirmed: true, robot });
    assert.equal(alertFor(one).word, "alert.estop_screen");
    const after = (seconds) =>
      alertFor(state(driving, { now: 100, releasedAt: 100 - seconds, robot: ROBOT }))?.word;
    assert.deepEqual([after(2), after(9)], ["alert.released", undefined]);
  });

  test("an e-stop, a fault and a contact are shown to drivers and viewers", () => {
    const say = (safety) =>
      alertFor(
        state(
          { phase: "watching", link: "live" },
          { robot: { safety: { ...ROBOT.safety, ...safety } } },
        ),
      )?.word;
    assert.equal(say({ estop: true }), "alert.estop");
    assert.equal(say({ inhibited: "fault" }), "alert.fault");
    assert.equal(say({ collision: true }), "alert.collision");
    assert.equal(say({}), undefined);
  });

  test("a contact is shown with its side until the robot has backed off", () => {
    const say = (...touched) =>
      alertFor(
        state(
          { phase: "driving", link: "live" },
          { robot: { safety: { ...ROBOT.safety, inhibited: "collision", touched } } },
        ),
      ).word;
    for (const [word, ...touched] of [
      ["ahead", "ahead"],
      ["left", "left"],
      ["left", "ahead", "left"],
      ["right", "ahead", "right"],
      ["behind", "behind"],
      ["behind", "left", "behind"],
      ["sides", "left", "right"],
      ["ends", "ahead", "left", "behind"],
    ]) {
      assert.equal(say(...touched), `alert.touched.${word}`);
      assert.ok(SENTENCES.has(`alert.touched.${word}`));
    }
  });

  test("a lost server is no danger for a driver with a live link", () => {
    assert.equal(
      alertFor(state({ phase: "driving", link: "live", socket: "lost" })).word,
      "alert.server_only",
    );
  });

  test("a robot with a live link is not shown as offline when the server has lost it", () => {
    assert.equal(
      alertFor(state({ phase: "driving", link: "live", online: false })).word,
      "alert.server_only",
    );
    assert.equal(
      alertFor(state({ phase: "driving", link: "lost", online: false })).word,
      "alert.robot_offline",
    );
    assert.equal(
      alertFor(state({ phase: "driving", link: "lost", online: false, serverBlind: true })).word,
      "alert.server",
    );
  });

  test("the driver is warned of a robot whose own navigation cannot be stopped", () => {
    const word = (mode, navigationControl, visit = {}) =>
      alertFor(
        state(
          { phase: "driving", link: "live", ...visit },
          { robot: { ...ROBOT, mode }, factsheet: { navigationControl } },
        ),
      )?.word;
    assert.equal(word("goto", "unguarded"), "alert.unguarded");
    assert.equal(word("docking", "unguarded"), "alert.unguarded");
    assert.notEqual(word("manual", "unguarded"), "alert.unguarded");
    assert.notEqual(word("goto", "guarded"), "alert.unguarded");
    const offline = { link: "lost", online: false };
    assert.equal(word("goto", "unguarded", offline), "alert.offline_unguarded");
    assert.equal(word("goto", "guarded", offline), "alert.robot_offline");
  });

  const PARTS = ["broker", "session_manager", "database"];
  const fault = (part, then, at = null) => ({
    faults: [{ part, then, at }],
    now: 100,
    robot: ROBOT,
  });
  const driving = (more, visit = {}) =>
    alertFor(state({ phase: "driving", link: "live", ...visit }, more));

  test("every part that fails has words for its consequences, for all visitors", () => {
    for (const phase of ["driving", "watching", "queued", "turn", "taking"]) {
      for (const part of PARTS) {
        for (const [then, at] of [
          ["waits", null],
          ["stops", 105],
          ["stopped", null],
        ]) {
          const said = alertFor(
            state({ phase, link: phase === "driving" ? "live" : "none" }, fault(part, then, at)),
          );
          assert.ok(
            said?.word.startsWith(`fault.${part}.`) && SENTENCES.has(said.word),
            `${phase} ${part} ${then}: ${said?.word}`,
          );
        }
      }
    }
    for (const word of [
      "fault.disk_low",
      "fault.disk_full",
      "fault.robot.stopped",
      "fault.robot.waits",
    ]) {
      assert.ok(SENTENCES.has(word), word);
    }
  });

  test("a waiting visitor reads about the queue, a viewer about the robot", () => {
    for (const part of PARTS) {
      for (const then of ["waits", "stops", "stopped"]) {
        const say = (/** @type {string} */ phase) =>
          alertFor(state({ phase, link: "live" }, fault(part, then, 105))).word;
        for (const phase of ["taking", "queued", "turn"]) {
          assert.equal(say(phase), `fault.${part}.waits`);
        }
        assert.equal(say("watching"), `fault.${part}.watched`);
      }
    }
    const gone = state({ phase: "watching", link: "none" }, fault("robot", "waits"));
    assert.equal(alertFor(gone).word, "fault.robot.stopped");
  });

  test("the seconds until the robot stops are counted down", () => {
    const stops = fault("session_manager", "stops", 107.2);
    assert.deepEqual(driving(stops), {
      word: "fault.session_manager.stops",
      tone: "danger",
      values: { seconds: 8 },
    });
    assert.equal(driving({ ...stops, now: 108 }).word, "fault.session_manager.stopped");
    assert.equal(driving({ ...stops, faults: [] }), null);
  });

  test("without a direct connection the robot stops with the broker at once", () => {
    const stops = fault("broker", "stops", 107);
    assert.equal(driving(stops, { online: false }).word, "fault.broker.stops");
    assert.equal(driving(stops, { online: false, link: "lost" }).word, "fault.broker.stopped");
  });

  test("a robot silent to the server has no alert while its link is live", () => {
    assert.equal(driving(fault("robot", "stopped")), null);
    assert.equal(driving(fault("robot", "stopped"), { link: "lost" }).word, "fault.robot.stopped");
  });

  test("a silent server counts as unreachable, and its last faults are not shown", () => {
    const silent = { ...fault("session_manager", "stops", 107), serverSilent: true };
    assert.equal(driving(silent).word, "alert.server_only");
    assert.equal(driving(silent, { link: "lost" }).word, "alert.server_driver");
    assert.equal(
      driving({ ...silent, serverSilent: false }, { link: "lost", socket: "lost" }).word,
      "alert.server_driver",
    );
    assert.equal(alertFor(state({ phase: "queued" }, { serverSilent: true })).word, "alert.server");
  });

  test("an e-stop comes before faults of the server, a full disk after them", () => {
    const estop = { robot: { safety: { ...ROBOT.safety, estop: true } } };
    assert.equal(driving({ ...fault("database", "stops", 107), ...estop }).word, "alert.estop");
    const disk = fault("disk_full", "goes_on");
    assert.deepEqual(driving(disk), { word: "fault.disk_full", tone: "busy" });
    assert.equal(driving({ ...disk, ...estop }).word, "alert.estop");
    assert.equal(
      driving({ ...disk, faults: [...disk.faults, { part: "database", then: "stops", at: 107 }] })
        .word,
      "fault.database.stops",
    );
  });

  test("a practice drive in a frame leaves the end of the turn to the page around it", () => {
    const framed = state(
      { phase: "driving", link: "live", turnEnds: 175 },
      { now: 100, robot: ROBOT, practising: true },
    );
    assert.equal(alertFor(framed), null);
  });

  test("the end of the turn is counted in minutes and seconds", () => {
    const one = state(
      { phase: "driving", link: "live", turnEnds: 175 },
      { now: 100, robot: ROBOT },
    );
    assert.deepEqual(alertFor(one).values, { time: "1:15" });
  });
});

describe("words", () => {
  test("counts choose their form by the language", () => {
    const words = createWords(
      new Map([
        ["w.one", "{n} Gast"],
        ["w.other", "{n} Gäste"],
      ]),
      "de",
    );
    assert.deepEqual([words.say("w", { n: 1 }), words.say("w", { n: 3 })], ["1 Gast", "3 Gäste"]);
  });

  test("braces without a value stay, and values are not patterns", () => {
    const words = createWords(new Map([["w", "{a} {b}"]]), "en");
    assert.equal(words.say("w", { a: "$&{b}" }), "$&{b} {b}");
  });

  test("no sentence is longer than twenty words or speaks of protocols", () => {
    for (const [key, sentence] of SENTENCES) {
      const said = sentence
        .replace(/\{%.*?%\}/g, (tag) => tag.match(/"(.*)"/)?.[1] ?? "")
        .replace(/\{\{.*?\}\}/g, "robot");
      assert.ok(said.split(/\s+/).length <= 20, key);
      assert.ok(!/\b(?:WebRTC|MQTT|ICE|sessions?|leases?|WebSocket|epoch)\b/i.test(said), key);
    }
  });
});

describe("dials", () => {
  const L = [
    [0, 0],
    [4, 0],
    [4, 1],
    [1, 1],
    [1, 3],
    [0, 3],
  ];

  test("a point is inside or outside of a room of any shape", () => {
    assert.deepEqual(
      [contains(L, 0.5, 2), contains(L, 3, 0.5), contains(L, 3, 2), contains(L, -1, 1)],
      [true, true, false, false],
    );
    assert.equal(roomAt({ rooms: [{ title: "Hall", polygon: L }] }, { x: 3, y: 0.5 }), "Hall");
    assert.equal(roomAt(null, { x: 0, y: 0 }), "");
  });

  test("a time is minutes and seconds", () => {
    assert.deepEqual([clockTime(0), clockTime(65.9), clockTime(3600)], ["0:00", "1:05", "60:00"]);
  });
});

describe("store", () => {
  test("changes are merged and published once a frame", () => {
    const frames = [];
    const store = createStore(newState(), (callback) => frames.push(callback));
    const told = [];
    store.subscribe(({ sound, notice }) => told.push([sound, notice]));
    store.update({ sound: true });
    store.update({ notice: "hi" });
    assert.equal(frames.length, 1);
    frames[0]();
    assert.deepEqual(told, [[true, "hi"]]);
  });
});

describe("modules", () => {
  const files = readdirSync(ROOT, { recursive: true }).filter(
    (name) =>
      name.endsWith(".js") && !/^(pages|waiting|view\/technical|drive\/load_retry)/.test(name),
  );
  const source = (name) => readFileSync(new URL(name, ROOT), "utf8");

  test("every import is relative and ends in a semicolon, so that it gets its hashed name", () => {
    for (const name of files) {
      for (const [statement] of source(name).matchAll(/^(?:import|export [{*])[^;]*;?/gm)) {
        assert.match(
          statement,
          /^(?:import|export) [^"';]* from ["']\.\.?\/[\w./]+\.js["'];$/,
          `${name}: ${statement}`,
        );
      }
    }
  });

  test("no module has a sentence for the visitor", () => {
    for (const name of files) {
      assert.ok(!/textContent = ["'`]|innerHTML|alert\(|confirm\(/.test(source(name)), name);
    }
  });
});

describe("a camera without video", () => {
  const camera = (status, reason = "") => ({
    robot: { ...ROBOT, cameraStatus: { status, reason } },
  });

  test("is shown as starting, although the link is live", () => {
    assert.equal(
      cardFor(state({ phase: "driving", link: "live" }, camera("starting"))).word,
      "link",
    );
    assert.equal(cardFor(state({ phase: "driving", link: "live" }, { robot: ROBOT })), null);
  });

  test("has its reason when it has failed or is tried again, before other findings", () => {
    for (const status of ["failed", "starting"]) {
      const card = cardFor(
        state(
          { phase: "watching", link: "live" },
          { ...camera(status, "connection refused"), finding: { word: "finding.relay" } },
        ),
      );
      assert.deepEqual(
        [card.word, card.detail],
        ["camera", { word: "camera.reason", values: { reason: "connection refused" } }],
      );
      assert.ok(
        ["camera.title", "camera.text", "camera.reason", "alert.camera"].every((key) =>
          SENTENCES.has(key),
        ),
      );
    }
  });

  test("has an alert over the last frame when it fails, and not while it starts", () => {
    const shown = (status, reason) =>
      alertFor(
        state({ phase: "driving", link: "live" }, { ...camera(status, reason), playing: true }),
      )?.word;
    assert.equal(shown("failed", "connection refused"), "alert.camera");
    assert.equal(shown("starting", "connection refused"), "alert.camera");
    assert.notEqual(shown("starting", ""), "alert.camera");
  });

  test("is not blamed while the robot is offline or moves by itself", () => {
    const said = (visit, more = {}) => {
      const one = state({ phase: "driving", ...visit }, { ...camera("failed", "gone"), ...more });
      return [cardFor(one)?.word, alertFor(one)?.word];
    };
    for (const link of ["connecting", "lost"]) {
      assert.deepEqual(said({ link, online: false }), [undefined, "alert.robot_offline"]);
      assert.deepEqual(said({ link, socket: "lost" }), [undefined, "alert.server_driver"]);
      assert.deepEqual(said({ link }, { serverSilent: true }), [undefined, "alert.server_driver"]);
    }
    assert.deepEqual(said({ link: "lost" }), [undefined, "alert.link_driver"]);
    const robot = { ...STANDSTILLS[2], cameraStatus: { status: "failed", reason: "gone" } };
    assert.deepEqual(said({ link: "live" }, { robot }), [undefined, "alert.not_connected"]);
    assert.ok(SENTENCES.has("alert.not_connected"));
    assert.deepEqual(said({ link: "lost" }, { slow: true })[0], "camera");
  });
});

describe("outdated states", () => {
  test("a fault or a stop is not shown once the robot and the server are lost", () => {
    for (const robot of STANDSTILLS) {
      const said = (visit) => alertFor(state({ phase: "driving", ...visit }, { robot })).word;
      assert.equal(said({ link: "lost", socket: "lost" }), "alert.server_driver");
      assert.notEqual(said({ link: "live", socket: "lost" }), "alert.server_driver");
    }
  });

  test("the speed of an offline robot is a dash", () => {
    const elements = new Map();
    const element = (id) => elements.get(id) ?? elements.set(id, { textContent: "" }).get(id);
    const show = createDials(element, "en");
    const speed = (robotAt) => {
      const robot = { ...ROBOT, velocity: { linear: 0.25 }, distance: 1 };
      show(state({ phase: "driving" }, { robot, robotAt, now: 100 }));
      return element("dial-speed").textContent;
    };
    assert.deepEqual([speed(99), speed(90)], ["0.25", "–"]);
  });
});

describe("the visitor's drive on another page", () => {
  const told = (visit, room = {}) => {
    const one = state({ phase: "lobby", ...visit }, { room: { ...free(), ...room } });
    return [cardFor(one).word, statusFor(one).word];
  };

  test("is named by the card and the status, also when that page has closed", () => {
    const there = { liveElsewhere: true, liveSince: 1e9 };
    assert.deepEqual(told(there), ["elsewhere", "status.own"]);
    assert.deepEqual(told({ phase: "elsewhere" }), ["elsewhere", "status.own"]);
    const gone = { liveElsewhere: false, liveSince: 1e9 };
    assert.deepEqual(told(gone, { driver: "Alex" }), ["lobby.own", "status.own"]);
    assert.equal(cardFor(state({ phase: "lobby", ...gone })).main.action, "drive");
  });

  test("is over when the robot has no driver, and when this page drove itself", () => {
    const there = { ...state().visit, liveElsewhere: true, liveSince: 1e9 };
    const freed = (phase) => reduce({ ...there, phase }, { type: "freed" }).visit;
    assert.deepEqual(told(freed("lobby")), ["lobby", "status.ready"]);
    assert.deepEqual(told(freed("elsewhere")), ["lobby", "status.ready"]);
    assert.equal(freed("driving").phase, "driving");
    const left = reduce({ ...there, phase: "driving", session: "s" }, { type: "leave" }).visit;
    assert.deepEqual(told(reduce(left, { type: "back" }).visit), ["lobby", "status.ready"]);
  });
});

describe("the distance of a drive", () => {
  test("continues when a restarted agent counts from zero", () => {
    const began = { at: 1, distance: 10 };
    const known = { boot: "a", distance: 13 };
    assert.equal(odometerAt(began, known, { boot: "a", distance: 14 }), began);
    const { at, distance } = odometerAt(began, known, { boot: "b", distance: 0 });
    assert.deepEqual([at, 0 - distance], [1, 3]);
    assert.equal(odometerAt(null, known, { boot: "b", distance: 0 }), null);
  });
});

describe("a visitor who waits", () => {
  test("is waiting also while the video of the robot connects", () => {
    for (const link of ["none", "connecting", "live", "lost"]) {
      const waiting = state({ phase: "queued", link, place: 1 }, { robot: ROBOT });
      assert.equal(statusFor(waiting).word, "status.waiting", link);
    }
  });
});

describe("frames through the server", () => {
  const slow = (link, more = {}) =>
    state({ phase: "driving", link }, { slow: true, playing: true, robot: ROBOT, ...more });

  test("are marked in the bar and by an alert", () => {
    for (const link of ["connecting", "lost"]) {
      assert.deepEqual(statusFor(slow(link)), { word: "status.driving", tone: "slow" });
      assert.equal(alertFor(slow(link)).word, "alert.slow_picture");
      assert.equal(cardFor(slow(link)), null);
    }
  });

  test("have an alert after more urgent ones, and keep their mark", () => {
    const touching = slow("lost", { robot: { safety: { ...ROBOT.safety, collision: true } } });
    assert.equal(alertFor(touching).word, "alert.collision");
    assert.equal(statusFor(touching).tone, "slow");
  });

  test("are not called slow when none arrive", () => {
    const stuck = slow("lost", { playing: false });
    assert.equal(alertFor(stuck).word, "alert.link_driver");
    assert.equal(statusFor(stuck).word, "status.reconnecting");
  });

  test("do not ask a viewer to drive gently", () => {
    const watching = state(
      { phase: "watching", link: "lost" },
      { slow: true, playing: true, robot: ROBOT },
    );
    assert.equal(alertFor(watching).word, "alert.slow_picture_observer");
  });
});

describe("an emergency stop", () => {
  const stopped = (phase, more = {}) =>
    state({ phase }, { robot: { ...ROBOT, ...STANDSTILLS[0] }, now: 100, ...more });
  const asked = { id: "release-1", since: 99, refused: false };

  test("is released by its operators, whether they drive, watch or wait", () => {
    for (const phase of ["driving", "watching"]) {
      assert.equal(offerFor(stopped(phase)), null);
      const offer = offerFor(stopped(phase, { operates: true }));
      assert.deepEqual([offer.word, offer.main.action], ["release.offered", "release_stop"]);
    }
    for (const phase of ["lobby", "queued"]) {
      assert.notEqual(cardFor(stopped(phase)).extra?.action, "release_stop");
      const card = cardFor(stopped(phase, { operates: true }));
      assert.deepEqual([card.detail.word, card.extra.action], ["release.offered", "release_stop"]);
    }
  });

  test("is being released, until the robot does, refuses or does not answer", () => {
    const at = (release, now = 100) =>
      offerFor(stopped("driving", { operates: true, release, now }));
    assert.deepEqual([at(asked).word, at(asked).main], ["release.asked", undefined]);
    assert.equal(at({ ...asked, refused: true }).word, "release.failed");
    assert.deepEqual(
      [at(asked, 104).word, at(asked, 104).main.action],
      ["release.failed", "release_stop"],
    );
    assert.ok(isRefusal(asked, { actionId: "release-1", status: "FAILED" }));
    assert.ok(!isRefusal(asked, { actionId: "another", status: "FAILED" }));
    assert.ok(!isRefusal(null, { actionId: "release-1", status: "FAILED" }));
    const free = state({ phase: "driving" }, { robot: ROBOT, operates: true, release: asked });
    assert.equal(offerFor(free), null);
  });
});
