import assert from "node:assert/strict";
import { describe, test } from "node:test";

import {
  awaitsAnswer,
  isSigning,
  newVisit,
  reduce,
  roleOf,
} from "../../../static/js/protocol/session.js";

const GRANTED = {
  session: "s1",
  epoch: 3,
  peer: "p1",
  resumed: false,
  iceServers: [],
  limits: { linear: null, angular: null, frameAge: null },
};
const HELLO = {
  peer: "p0",
  stamp: 1,
  robot: "giraff",
  online: true,
  mayDrive: true,
  mayObserve: true,
  liveElsewhere: false,
};

/** Runs happenings one after the other and collects what is to be done. */
const play = (...happenings) =>
  happenings.reduce(({ visit }, happening) => reduce(visit, { now: 100, ...happening }), {
    visit: newVisit(),
    effects: [],
  });
const after = (visit, happening) => reduce(visit, { now: 100, ...happening });
const message = (type, content) => ({ type, message: content });
const sent = (effects) =>
  effects
    .filter(({ type }) => type === "send")
    .map(({ suffix, message: content }) => [suffix, content]);
const kinds = (effects) => effects.map(({ type }) => type);

const OPEN = [{ type: "socket_open" }, message("hello", HELLO)];
const WAITED = [...OPEN, { type: "drive", now: 94 }];
const DRIVING = [
  ...OPEN,
  { type: "drive" },
  message("session/granted", GRANTED),
  { type: "link_live" },
];

describe("taking the robot", () => {
  test("the page waits in the lobby until the visitor requests the robot", () => {
    const { visit, effects } = play(...OPEN);
    assert.equal(visit.phase, "lobby");
    assert.deepEqual(effects, []);
  });

  test("a request prepares the link while the server decides", () => {
    const { visit, effects } = play(...OPEN, { type: "drive" });
    assert.equal(visit.phase, "taking");
    assert.deepEqual(kinds(effects), ["prepare_link", "send"]);
    assert.deepEqual(sent(effects), [["session/take", {}]]);
  });

  test("the demo's link requests the robot when the socket opens, before any message", () => {
    const { effects } = play({ type: "loaded", session: null, go: true }, { type: "socket_open" });
    assert.deepEqual(sent(effects), [["session/take", {}]]);
  });

  test("a grant binds the controls and opens the link at once", () => {
    const { visit, effects } = play(
      ...OPEN,
      { type: "drive" },
      message("session/granted", GRANTED),
    );
    assert.equal(visit.phase, "driving");
    assert.deepEqual(kinds(effects), ["remember", "control", "open_link"]);
    assert.equal(effects[1].lease.epoch, 3);
    assert.equal(effects[2].role, "driver");
    assert.equal(effects[2].attempt, 0);
  });

  test("a refusal has a reason and releases the prepared link", () => {
    const { visit, effects } = play(
      ...OPEN,
      { type: "drive" },
      message("session/refused", { reason: "not_invited", session: null }),
    );
    assert.equal(visit.phase, "refused");
    assert.equal(visit.reason, "not_invited");
    assert.ok(kinds(effects).includes("close_link"));
  });
});

describe("lost connections", () => {
  test("a lost WebSocket does not change a drive over the data channel", () => {
    const { visit, effects } = play(...DRIVING, { type: "socket_closed", code: 1006 });
    assert.equal(visit.phase, "driving");
    assert.equal(visit.link, "live");
    assert.deepEqual(effects, []);
  });

  test("a reconnected page resumes with its session and peer", () => {
    const { effects } = play(
      ...DRIVING,
      { type: "socket_closed", code: 1006 },
      { type: "socket_open" },
    );
    assert.deepEqual(sent(effects), [["session/take", { session: "s1", peer: "p1" }]]);
  });

  test("a resumed grant of the same epoch keeps a live link", () => {
    const { visit, effects } = play(
      ...DRIVING,
      { type: "socket_closed", code: 1006 },
      { type: "socket_open" },
      message("session/granted", { ...GRANTED, resumed: true }),
    );
    assert.equal(visit.link, "live");
    assert.ok(!kinds(effects).includes("open_link"));
  });

  test("a grant of a new epoch opens a new link", () => {
    const { visit, effects } = play(
      ...DRIVING,
      message("session/granted", { ...GRANTED, epoch: 4, peer: "p2" }),
    );
    assert.equal(visit.link, "connecting");
    assert.ok(kinds(effects).includes("open_link"));
  });

  test("a resumed grant opens a new link when the old one has failed", () => {
    const lost = play(
      ...DRIVING,
      { type: "socket_closed", code: 1006 },
      { type: "link_lost" },
      { type: "socket_open" },
    );
    const { effects } = after(
      lost.visit,
      message("session/granted", { ...GRANTED, resumed: true }),
    );
    assert.ok(kinds(effects).includes("open_link"));
  });

  test("a lost link is opened again, after growing pauses, until one is live", () => {
    let { visit } = play(...DRIVING);
    const attempts = [];
    for (let i = 0; i < 3; i += 1) {
      const next = after(visit, { type: "link_lost" });
      visit = next.visit;
      attempts.push(next.effects[0].attempt);
    }
    assert.deepEqual(attempts, [0, 1, 2]);
    assert.equal(visit.link, "lost");
    assert.equal(after(visit, { type: "link_live" }).visit.attempt, 0);
  });

  test("a link to a robot that is online again is opened at once", () => {
    const gone = play(...DRIVING, message("robot", { online: false, reason: "" }), {
      type: "link_lost",
    });
    const { effects } = after(gone.visit, message("robot", { online: true, reason: "" }));
    assert.deepEqual([effects[0].type, effects[0].attempt], ["open_link", 0]);
  });

  test("a link that is lost without a role has no effect", () => {
    assert.deepEqual(play(...OPEN, { type: "link_lost" }).effects, []);
  });

  test("an offered turn is not accepted by a reconnection", () => {
    const { effects } = play(
      ...WAITED,
      message("session/offered", { session: "s1", seconds: 60 }),
      { type: "socket_closed", code: 1006 },
      { type: "socket_open" },
    );
    assert.deepEqual(effects, []);
  });
});

describe("reload and other tabs", () => {
  test("a reloaded page returns to its session without a peer, which the server renews", () => {
    const { effects } = play(
      { type: "loaded", session: "s1", takeover: true, go: false },
      { type: "socket_open" },
    );
    assert.deepEqual(sent(effects), [["session/take", { session: "s1", takeover: true }]]);
  });

  test("a stored session that has ended leads to the lobby, not to a card of its end", () => {
    const { visit } = play(
      { type: "loaded", session: "s1", go: false },
      { type: "socket_open" },
      message("hello", HELLO),
      message("session/refused", { reason: "ended", session: "s1" }),
    );
    assert.equal(visit.phase, "lobby");
  });

  test("a drive that ended during a disconnection shows its outcome, if known", () => {
    const end = (more) =>
      play(...DRIVING, message("session/refused", { reason: "ended", session: "s1", ...more }))
        .visit;
    const told = end({ outcome: "robot_fault" });
    assert.deepEqual([told.phase, told.reason], ["ended", "robot_fault"]);
    assert.equal(end({ outcome: "" }).reason, "connection_lost");
  });

  test("with the demo's link an ended session is replaced by a new one", () => {
    const { visit, effects } = play(
      { type: "loaded", session: "s1", go: true },
      { type: "socket_open" },
      message("session/refused", { reason: "ended", session: "s1" }),
    );
    assert.equal(visit.phase, "taking");
    assert.deepEqual(sent(effects), [["session/take", {}]]);
  });

  test("a second tab asks, and takes over only when confirmed", () => {
    const { visit } = play(
      ...OPEN,
      { type: "drive" },
      message("session/refused", { reason: "elsewhere", session: "s1" }),
    );
    assert.equal(visit.phase, "elsewhere");
    assert.deepEqual(sent(after(visit, { type: "take_over" }).effects), [
      ["session/take", { session: "s1", takeover: true }],
    ]);
  });

  test("a session that moved to another tab releases everything here", () => {
    const { visit, effects } = play(
      ...DRIVING,
      message("session/ended", { session: "s1", outcome: "moved", reason: "" }),
    );
    assert.deepEqual([visit.phase, visit.reason], ["ended", "moved"]);
    assert.deepEqual(kinds(effects), ["control", "close_link", "forget"]);
  });
});

describe("queue and turn", () => {
  const QUEUED = { session: "s2", place: 2, minutes: 7 };

  test("a waiting visitor watches", () => {
    const { visit, effects } = play(...OPEN, { type: "drive" }, message("session/queued", QUEUED));
    assert.equal(visit.phase, "queued");
    assert.deepEqual(sent(effects), [["session/observe", {}]]);
    const watching = after(visit, message("session/observing", { iceServers: [] }));
    assert.equal(watching.visit.phase, "queued");
    assert.equal(watching.effects[0].role, "observer");
    assert.equal(roleOf(watching.visit), "observer");
  });

  test("a viewer by the SFU returns to it, sees why it is down, and drives without it", () => {
    const watching = play(
      ...OPEN,
      { type: "watch" },
      message("session/observing", { iceServers: [], sfu: true }),
    );
    assert.deepEqual(
      watching.effects.map(({ type, role }) => [type, role]),
      [["open_link", "sfu"]],
    );
    const told = after(
      watching.visit,
      message("signal/reply", { type: "bye", reason: "sfu_lost" }),
    );
    assert.equal(told.visit.sfuLost, true);
    const lost = after(told.visit, { type: "link_lost" });
    assert.equal(lost.effects[0].role, "sfu");
    assert.equal(after(lost.visit, { type: "link_live" }).visit.sfuLost, false);
    const left = after(told.visit, { type: "leave" });
    assert.deepEqual([left.visit.sfu, left.visit.sfuLost], [false, false]);
  });

  test("a visitor waits without video when all places are taken", () => {
    const { visit } = play(
      ...OPEN,
      { type: "drive" },
      message("session/queued", QUEUED),
      message("session/refused", { reason: "observers_full", session: null }),
    );
    assert.equal(visit.phase, "queued");
  });

  test("a private drive is not shown to waiting visitors, and ends the page of viewers", () => {
    const refused = message("session/refused", { reason: "private", session: null });
    const observing = message("session/observing", { iceServers: [] });
    const waits = play(
      ...OPEN,
      { type: "drive" },
      message("session/queued", QUEUED),
      observing,
      refused,
    );
    assert.deepEqual([waits.visit.phase, waits.visit.link], ["queued", "none"]);
    assert.deepEqual(waits.effects, [{ type: "close_link" }]);
    const again = after(waits.visit, observing);
    assert.deepEqual([again.visit.phase, again.visit.link], ["queued", "connecting"]);
    const { visit } = play(...OPEN, { type: "watch" }, observing, refused);
    assert.deepEqual([visit.phase, visit.link], ["lobby", "none"], "which says why");
  });

  test("updates of the queue change the place only", () => {
    const { visit, effects } = play(
      ...OPEN,
      { type: "drive" },
      message("session/queued", QUEUED),
      message("session/queued", { ...QUEUED, place: 1, minutes: 3 }),
    );
    assert.deepEqual([visit.place, visit.minutes], [1, 3]);
    assert.deepEqual(effects, []);
  });

  test("a turn is counted down from its offer, and started by the visitor", () => {
    const { visit, effects } = play(
      ...WAITED,
      message("session/queued", QUEUED),
      message("session/offered", { session: "s2", seconds: 60 }),
    );
    assert.deepEqual([visit.phase, visit.startBy, kinds(effects)], ["turn", 160, ["call"]]);
    assert.deepEqual(sent(after(visit, { type: "start" }).effects), [
      ["session/take", { session: "s2" }],
    ]);
  });

  test("a repeated offer does not call again, and never ends a drive", () => {
    const turn = [...WAITED, message("session/offered", { session: "s1", seconds: 60 })];
    const again = message("session/offered", { session: "s1", seconds: 50 });
    const { visit, effects } = play(...turn, again);
    assert.deepEqual([visit.phase, visit.startBy, effects], ["turn", 150, []]);
    const driving = after(play(...DRIVING).visit, again);
    assert.deepEqual([driving.visit.phase, driving.effects], ["driving", []]);
  });

  test("a repeated offer does not undo a start in progress", () => {
    const turn = [...WAITED, message("session/offered", { session: "s1", seconds: 60 })];
    const again = message("session/offered", { session: "s1", seconds: 50 });
    const { visit, effects } = play(...turn, { type: "start" }, again);
    assert.deepEqual([visit.phase, effects], ["taking", []]);
    const reconnected = [{ type: "socket_closed", code: 1006 }, { type: "socket_open" }];
    assert.deepEqual(sent(play(...turn, { type: "start" }, again, ...reconnected).effects), [
      ["session/take", { session: "s1" }],
    ]);
  });

  test("an offer of a declined turn, or for another page, does not call", () => {
    const turn = [...WAITED, message("session/offered", { session: "s1", seconds: 60 })];
    const again = message("session/offered", { session: "s1", seconds: 50 });
    const elsewhere = message("session/refused", { reason: "elsewhere", session: "s1" });
    for (const [before, phase] of [
      [[...turn, { type: "leave" }], "lobby"],
      [[...turn, { type: "turn_missed" }], "ended"],
      [[...WAITED, elsewhere], "elsewhere"],
    ]) {
      const { visit, effects } = play(...before, again);
      assert.deepEqual([visit.phase, effects], [phase, []]);
    }
    const other = message("session/offered", { session: "s9", seconds: 50 });
    const queued = play(...WAITED, message("session/queued", QUEUED)).visit;
    const { visit, effects } = after(queued, other);
    assert.deepEqual([visit.phase, visit.session, effects], ["queued", "s2", []]);
  });

  test("a turn offered just after a press needs no other press", () => {
    const waiting = [
      message("session/queued", QUEUED),
      message("session/offered", { session: "s2", seconds: 60 }),
    ];
    for (const pressed of [
      [...OPEN, { type: "drive" }],
      [{ type: "loaded", session: null, go: true }, ...OPEN],
    ]) {
      const { visit, effects } = play(...pressed, ...waiting);
      assert.deepEqual(
        [visit.phase, sent(effects)],
        ["taking", [["session/take", { session: "s2" }]]],
      );
    }
    const again = play(...OPEN, { type: "drive" }, ...waiting, ...waiting);
    assert.equal(again.visit.phase, "turn", "one press is for one turn");
    for (const go of [false, true]) {
      assert.equal(
        play({ type: "loaded", session: "s2", go }, ...OPEN, ...waiting).visit.phase,
        "turn",
        "a reload is no press",
      );
    }
  });

  test("a missed turn is given up with a notice", () => {
    const { visit, effects } = play(
      ...WAITED,
      message("session/offered", { session: "s2", seconds: 60 }),
      { type: "turn_missed" },
    );
    assert.deepEqual([visit.phase, visit.reason], ["ended", "turn_missed"]);
    assert.deepEqual(sent(effects), [["session/leave", {}]]);
  });

  test("a visitor who is asked for activity is called once", () => {
    const asked = play(...DRIVING, message("session/asked_there", { session: "s1", seconds: 30 }));
    assert.equal(asked.visit.askedUntil, 130);
    assert.deepEqual(asked.effects, [{ type: "call", word: "idle" }]);
    const answered = after(asked.visit, { type: "here" }).visit;
    assert.equal(answered.askedUntil, null);
    assert.deepEqual(
      [isSigning(answered, 101), isSigning(answered, 131)],
      [true, false],
      "given again until the server has it, or has stopped waiting",
    );
    assert.ok(
      isSigning(after(answered, { type: "here" }).visit, 101),
      "a later touch changes nothing",
    );
    assert.ok(
      !isSigning(after(answered, message("session/found_there", { session: "s1" })).visit, 101),
    );
    assert.ok(!isSigning(after(play(...DRIVING).visit, { type: "here" }).visit, 101));
    assert.deepEqual(
      [
        after(asked.visit, message("session/found_there", { session: "s1" })).visit.askedUntil,
        after(asked.visit, message("session/found_there", { session: "s1" })).effects,
      ],
      [null, []],
    );
  });

  test("a visitor without activity sees that when the session ends", () => {
    const { visit } = play(
      ...DRIVING,
      message("session/asked_there", { session: "s1", seconds: 30 }),
      message("session/ended", { session: "s1", outcome: "timed_out", reason: "idle" }),
    );
    assert.deepEqual([visit.phase, visit.reason, visit.askedUntil], ["ended", "idle", null]);
  });

  test("a warning shows when the turn ends", () => {
    assert.equal(
      play(...DRIVING, message("session/turn_warning", { session: "s1", remaining: 90 })).visit
        .turnEnds,
      190,
    );
  });

  test("a warning of maintenance says why, and is withdrawn", () => {
    const warn = (/** @type {number | null} */ remaining, reason = "") =>
      message("session/turn_warning", { session: "s1", remaining, reason });
    const { visit } = play(...DRIVING, warn(90, "maintenance"));
    assert.deepEqual([visit.turnEnds, visit.turnReason], [190, "maintenance"]);
    const { visit: after } = play(...DRIVING, warn(90, "maintenance"), warn(null));
    assert.deepEqual([after.turnEnds, after.turnReason], [null, ""]);
  });

  test("maintenance ends the drive in its own words", () => {
    const end = { session: "s1", outcome: "stopped_by_operator", reason: "maintenance" };
    const { visit } = play(...DRIVING, message("session/ended", end));
    assert.deepEqual([visit.phase, visit.reason], ["ended", "maintenance"]);
  });
});

describe("a page that is open for hours", () => {
  const HOUR = 3600;
  const iceServers = [{ urls: ["turn:relay.example.org"], username: "1:ana", credential: "old" }];
  const fresh = [{ ...iceServers[0], credential: "new" }];
  const LATE = { type: "link_lost", now: 100 + 5 * HOUR };

  test("opens a lost link with new credentials for the relay", () => {
    const granted = message("session/granted", { ...GRANTED, iceServers });
    const lost = play(...DRIVING, granted, { type: "link_live" }, LATE);
    assert.deepEqual(sent(lost.effects), [["session/take", { session: "s1", peer: "p1" }]]);
    assert.equal(lost.effects[0].type, "open_link", "and tries the old ones meanwhile");
    const answer = { ...GRANTED, resumed: true, iceServers: fresh };
    const again = after(lost.visit, { ...message("session/granted", answer), now: LATE.now });
    assert.deepEqual(again.effects.at(-1).iceServers, fresh);
    assert.deepEqual(sent(after(again.visit, { ...LATE, now: LATE.now + 60 }).effects), []);
  });

  test("requests new ones also for viewers and waiting visitors", () => {
    const observing = message("session/observing", { iceServers, sfu: false });
    const queued = message("session/queued", { session: "s2", place: 1, minutes: 1 });
    for (const before of [[{ type: "watch" }], [{ type: "drive", now: 50 }, queued]]) {
      const lost = play(...OPEN, ...before, observing, { type: "link_live" }, LATE);
      assert.deepEqual(sent(lost.effects), [["session/observe", {}]]);
    }
  });

  test("requests none early, or without a relay", () => {
    const granted = message("session/granted", { ...GRANTED, iceServers });
    const early = play(...DRIVING, granted, { type: "link_live" }, { ...LATE, now: 100 + HOUR });
    assert.deepEqual(sent(early.effects), []);
    assert.deepEqual(sent(play(...DRIVING, LATE).effects), []);
  });
});

describe("a missing answer", () => {
  test("a request without an answer is repeated, while it matters", () => {
    const asking = play(...OPEN, { type: "drive" });
    assert.deepEqual(sent(after(asking.visit, { type: "no_answer" }).effects), [
      ["session/take", {}],
    ]);
    assert.deepEqual(play(...DRIVING, { type: "no_answer" }).effects, []);
  });

  test("leaving is repeated until the server confirms the end", () => {
    const left = play(...DRIVING, { type: "leave" });
    assert.ok(awaitsAnswer(left.visit));
    const repeated = [["session/leave", { session: "s1", peer: "p1" }]];
    assert.deepEqual(sent(after(left.visit, { type: "no_answer" }).effects), repeated);
    const busy = after(
      left.visit,
      message("denied", { suffix: "session/leave", reason: "unavailable" }),
    );
    assert.deepEqual(sent(after(busy.visit, { type: "no_answer" }).effects), repeated);
    for (const answer of [
      message("session/ended", { session: "s1", outcome: "completed" }),
      message("denied", { suffix: "session/leave", reason: "not_yours" }),
    ]) {
      const over = after(left.visit, answer);
      assert.deepEqual(
        [awaitsAnswer(over.visit), after(over.visit, { type: "no_answer" }).effects],
        [false, []],
      );
    }
    assert.ok(!awaitsAnswer(play(...DRIVING).visit));
  });

  test("an end during an offered turn is a missed turn, unless by an operator", () => {
    const turn = [...WAITED, message("session/offered", { session: "s1", seconds: 60 })];
    const end = (outcome) =>
      play(...turn, message("session/ended", { session: "s1", outcome, reason: "" })).visit.reason;
    assert.deepEqual(
      [end("cancelled"), end("stopped_by_operator")],
      ["turn_missed", "stopped_by_operator"],
    );
  });
});

describe("ends", () => {
  test("leaving releases the robot first and informs the server last", () => {
    const { visit, effects } = play(...DRIVING, { type: "leave" });
    assert.deepEqual([visit.phase, visit.reason, visit.session], ["ended", "left", null]);
    assert.deepEqual(kinds(effects), ["control", "close_link", "forget", "send"]);
  });

  test("leaving without a connection is repeated with the next one, until confirmed", () => {
    const left = play(...DRIVING, { type: "socket_closed", code: 1006 }, { type: "leave" });
    assert.equal(left.visit.phase, "ended");
    assert.deepEqual(sent(left.effects), []);
    const back = after(left.visit, { type: "socket_open" });
    assert.deepEqual(sent(back.effects), [["session/leave", { session: "s1", peer: "p1" }]]);
    const again = after(back.visit, { type: "socket_open" });
    assert.deepEqual(sent(again.effects), [["session/leave", { session: "s1", peer: "p1" }]]);
    const confirmed = after(
      again.visit,
      message("session/ended", { session: "s1", outcome: "completed", reason: "left" }),
    );
    assert.deepEqual(sent(after(confirmed.visit, { type: "socket_open" }).effects), []);
  });

  test("leaving is repeated before a new session is requested", () => {
    const { effects } = play(
      ...DRIVING,
      { type: "socket_closed", code: 1006 },
      { type: "leave" },
      { type: "drive" },
      { type: "socket_open" },
    );
    assert.deepEqual(
      sent(effects).map(([suffix]) => suffix),
      ["session/leave", "session/take"],
    );
  });

  test("the end of another session is ignored", () => {
    assert.equal(
      play(
        ...DRIVING,
        message("session/ended", { session: "other", outcome: "completed", reason: "" }),
      ).visit.phase,
      "driving",
    );
  });

  for (const [code, reason] of [
    [4401, "signed_out"],
    [4403, "not_allowed"],
    [4404, "no_such_robot"],
  ]) {
    test(`close code ${code} closes the page for good: ${reason}`, () => {
      const { visit, effects } = play(...DRIVING, { type: "socket_closed", code });
      assert.deepEqual([visit.phase, visit.reason], ["closed", reason]);
      assert.ok(kinds(effects).includes("close_socket"));
    });
  }

  test("a viewer without a free place sees so", () => {
    const { visit } = play(
      ...OPEN,
      { type: "watch" },
      message("session/observing", { iceServers: [] }),
      message("signal/reply", { type: "bye", reason: "full" }),
    );
    assert.deepEqual([visit.phase, visit.reason], ["refused", "observers_full"]);
  });

  test("after an end the visitor can start again", () => {
    const { visit } = play(
      ...DRIVING,
      message("session/ended", { session: "s1", outcome: "timed_out", reason: "" }),
    );
    assert.deepEqual(sent(after(visit, { type: "drive" }).effects), [["session/take", {}]]);
  });

  test("an unknown event changes nothing", () => {
    const { visit } = play(...DRIVING);
    assert.deepEqual(after(visit, { type: "weather" }), { visit, effects: [] });
  });
});
