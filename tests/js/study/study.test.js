import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { describe, test } from "node:test";

import { TransportRouter } from "../../../static/js/protocol/transport_router.js";
import { newVisit, reduce } from "../../../static/js/protocol/session.js";
import { Keyboard } from "../../../static/js/input/keyboard.js";
import { KeyDispatcher } from "../../../static/js/input/key_dispatcher.js";
import { alertFor } from "../../../static/js/view/hud/alert.js";
import { cardFor } from "../../../static/js/view/hud/card.js";
import { menuFor } from "../../../static/js/autonomy/map_bar.js";
import { offerFor } from "../../../static/js/autonomy/offer.js";
import { can, isAssistFixed, maySend, maySteer } from "../../../static/js/protocol/capabilities.js";
import { createWords } from "../../../static/js/lib/words.js";
import { newState } from "../../../static/js/drive/features.js";
import { ask, heard } from "../../../static/js/protocol/robot_action.js";
import { GO_ON_SECONDS, hasEnded } from "../../../static/js/study/end_cards.js";
import { guideFor, hear, stopsOf, targetOf } from "../../../static/js/study/guide.js";
import { AnnouncerQueue, roundLeft } from "../../../static/js/study/announcer_queue.js";
import { marksFor } from "../../../static/js/study/course.js";
import { Changes, Shown, layoutOf } from "../../../static/js/study/page_events.js";
import { sentence } from "../../../static/js/study/task_panel.js";
import { answerAfter, windowFor } from "../../../static/js/study/photo.js";
import { pointTo } from "../../../static/js/study/direction_arrow.js";
import { Snapshots } from "../../../static/js/study/snapshots.js";

const read = (name) => readFileSync(new URL(`../../../${name}`, import.meta.url), "utf8");
const SENTENCES = new Map(
  Array.from(
    (
      read("templates/sessions/_words.html") + read("templates/sessions/_study_words.html")
    ).matchAll(/data-word="([^"]+)">\{% translate "(.*?)"/g),
    ([, key, text]) => [key, text],
  ),
);
const CUES = Array.from(
  read("experiments/definition/cues.py").matchAll(/Key = Literal\[([^\]]*)\]/g),
).flatMap(([, keys]) => Array.from(keys.matchAll(/"(\w+)"/g), ([, key]) => key));
const OUTCOMES = Array.from(
  /Outcome = Literal\[([^\]]*)\]/
    .exec(read("experiments/definition/schema.py"))[1]
    .matchAll(/"(\w+)"/g),
  ([, key]) => key,
);
const words = createWords(SENTENCES, "en");

const STUDY = {
  kind: "task",
  minutes: 15,
  checkpoints: [
    { number: 0, x: 0, y: 0, radius: 0.6, title: "Station" },
    { number: 1, x: 2, y: 0, radius: 0.6, title: "Door" },
    { number: 2, x: 4, y: 3, radius: 0.5, title: "Window" },
  ],
  dock: { x: 0.1, y: 0, theta: 3.14 },
  path: [
    [0, 0],
    [2, 0],
    [4, 3],
  ],
  zones: [
    {
      name: "hall",
      title: "Hall",
      polygon: [
        [0, 0],
        [1, 0],
        [1, 1],
      ],
    },
  ],
  doors: [],
  photo: { checkpoint: 2 },
  controllers: ["keyboard", "stick"],
  ownActions: [],
  actions: ["stop", "photo", "relocalize"],
  assist: "off",
  urls: { step: "/study/step/" },
};
const frame = (more = {}) => ({
  session: "s",
  stamp: 1,
  cue: "go_to_checkpoint",
  number: 1,
  x: 2,
  y: 0,
  passed: [],
  remaining: null,
  window: "shut",
  photo: "",
  outcome: "",
  doors: [],
  ...more,
});
const progress = (more = {}, now = 100) => hear(frame(more), now);
const robot = (more = {}) => ({
  docked: false,
  assist: "off",
  pose: { x: 0, y: 0, theta: 0, localized: true },
  safety: { estop: false, inhibited: null, collision: false },
  ...more,
});
const state = (more = {}, visit = {}) => ({
  ...newState(),
  study: STUDY,
  progress: progress(),
  now: 100,
  playing: true,
  arrival: { session: "s", stopId: null, isOver: true, since: 0 },
  robot: robot(),
  factsheet: { capabilities: ["velocity", "goto", "dock", "undock", "relocalize", "assist"] },
  visit: {
    ...newVisit(),
    socket: "open",
    online: true,
    mayDrive: true,
    mayObserve: true,
    phase: "driving",
    link: "live",
    session: "s",
    ...visit,
  },
  ...more,
});

describe("the guide", () => {
  test("has a sentence of at most twenty words for every cue there is", () => {
    assert.ok(CUES.length >= 16);
    for (const cue of [...CUES, "practice"]) {
      assert.ok(SENTENCES.has(`cue.${cue}`), cue);
      assert.ok(words.say(`cue.${cue}`, { number: 2 }).split(" ").length <= 20, cue);
    }
  });

  test("names the checkpoint of the cue and its place", () => {
    const guide = guideFor(state());
    assert.deepEqual(
      [guide.cue, guide.number, guide.place, guide.left],
      ["cue.go_to_checkpoint", 1, "Door", null],
    );
    assert.equal(sentence(guide, words), "Go to checkpoint 1.");
  });

  test("has a general sentence for an unknown cue", () => {
    assert.equal(
      sentence(guideFor(state({ progress: progress({ cue: "juggle" }) })), words),
      "Continue the task.",
    );
  });

  test("waits for the video until the session manager has sent a task", () => {
    assert.equal(guideFor(state({ progress: null })).cue, "cue.wait_for_picture");
  });

  test("is only for the driver of a study", () => {
    assert.equal(guideFor(state({}, { phase: "queued", link: "none" })), null);
    assert.equal(guideFor(state({}, { phase: "watching" })), null);
    assert.equal(guideFor(state({ study: null })), null);
  });

  test("puts the dock last, and has exactly one next stop until all are passed", () => {
    const statuses = (more) =>
      stopsOf(STUDY, progress(more)).map(({ number, status }) => `${number} ${status}`);
    assert.deepEqual(statuses({}), ["1 next", "2 later", "0 later"]);
    assert.deepEqual(statuses({ passed: [1] }), ["1 passed", "2 next", "0 later"]);
    assert.deepEqual(statuses({ passed: [1, 2] }), ["1 passed", "2 passed", "0 next"]);
    assert.deepEqual(statuses({ passed: [1, 2], window: "open" }), [
      "1 passed",
      "2 passed",
      "0 later",
    ]);
    assert.deepEqual(statuses({ passed: [1, 2], outcome: "completed" }), [
      "1 passed",
      "2 passed",
      "0 passed",
    ]);
  });

  test("counts the last minutes down by the page's clock, and not below zero", () => {
    const last = progress({ remaining: 90 }, 100);
    assert.equal(guideFor(state({ progress: last, now: 130 })).left, 60);
    assert.equal(guideFor(state({ progress: last, now: 999 })).left, 0);
    assert.equal(
      guideFor(state({ progress: progress({ remaining: 90, outcome: "timed_out" }), now: 130 }))
        .left,
      null,
    );
  });

  test("has the time driven, for screens without dials", () => {
    const began = { at: 40, distance: 0 };
    assert.equal(guideFor(state({ began })).driven, 60);
    assert.equal(guideFor(state()).driven, null);
    assert.equal(words.say("reading.driven", { time: "1:00" }), "Time 1:00");
  });

  test("shows the time of a practice drive in its last minute", () => {
    const practice = { ...STUDY, kind: "practice", minutes: 3, checkpoints: [] };
    const at = (now, more = {}) =>
      guideFor(
        state({ study: practice, progress: null, began: { at: 0, distance: 0 }, now, ...more }),
      ).left;
    assert.deepEqual([at(100), at(150), at(500)], [null, 30, 0]);
    assert.equal(at(100, { progress: progress({ cue: "practice", remaining: 20 }, 90) }), 10);
  });
});

describe("the arrow", () => {
  const at = (x, y, theta) => pointTo({ x: 0, y: 0, theta }, { x, y }, Math.PI / 2);
  test("is above the target in the video", () => {
    assert.deepEqual([at(2, 0, 0).side, at(2, 0, 0).distance], ["ahead", 2]);
    assert.ok(Math.abs(at(2, 1, 0).share + 0.5) < 1e-9);
    assert.ok(Math.abs(at(2, -1, 0).share - 0.5) < 1e-9);
  });

  test("points aside to a target out of view, and back to one behind", () => {
    assert.deepEqual(
      [at(0, 2, 0).side, at(0, -2, 0).side, at(-2, 0.1, 0).side],
      ["left", "right", "behind"],
    );
    assert.deepEqual(
      [at(-2, -0.1, Math.PI - 0.01).side, at(-2, 0.1, -Math.PI + 0.01).side],
      ["ahead", "ahead"],
    );
    assert.deepEqual([at(0, 2, 0).share, at(0, -2, 0).share], [-1, 1]);
  });

  test("does not ask to leave the dock while the robot does so", () => {
    const leaves = (status) =>
      guideFor(
        state({ progress: progress({ cue: "leave_station" }), task: { type: "undock", status } }),
      ).cue;
    assert.deepEqual(["ASKED", "RUNNING", "CANCELLED"].map(leaves), [
      "cue.leaving_station",
      "cue.leaving_station",
      "cue.leave_station",
    ]);
  });

  test("is hidden while docked, during a review, and after the end", () => {
    assert.deepEqual(targetOf(state()), { x: 2, y: 0, number: 1 });
    for (const more of [
      { cue: "leave_station" },
      { window: "review" },
      { outcome: "timed_out" },
      { x: null, y: null },
    ]) {
      assert.equal(targetOf(state({ progress: progress(more) })), null);
    }
    assert.equal(targetOf(state({ progress: null })), null);
  });
});

describe("the map", () => {
  test("has every stop in its place, the dock at its docked pose", () => {
    const { stops, zones, path } = marksFor(STUDY, progress({ passed: [1] }));
    assert.deepEqual(
      stops.map(({ number, x, y, status }) => [number, x, y, status]),
      [
        [1, 2, 0, "passed"],
        [2, 4, 3, "next"],
        [0, 0.1, 0, "later"],
      ],
    );
    assert.deepEqual([zones.length, path.length], [1, 3]);
  });

  test("has no marks without a study or in a practice drive", () => {
    assert.equal(marksFor(null, null), null);
    assert.equal(marksFor({ ...STUDY, checkpoints: [] }, null), null);
  });
});

describe("the photo's window", () => {
  const open = (more = {}) =>
    state({
      progress: progress({ cue: "photo_turn_left", window: "open", passed: [1, 2], ...more }),
    });
  const review = progress({ cue: "photo_review", window: "review", photo: "p1", passed: [1, 2] });

  test("opens with a hint, and closes", () => {
    assert.deepEqual(windowFor(open()), {
      mode: "hint",
      word: "photo.photo_turn_left",
      photo: "",
      busy: false,
    });
    assert.equal(windowFor(state()), null);
    assert.equal(windowFor(open({ outcome: "completed" })), null);
  });

  test("has a sentence for every hint", () => {
    for (const cue of CUES.filter((key) => key.startsWith("photo_") && key !== "photo_review")) {
      assert.ok(SENTENCES.has(`photo.${cue}`), cue);
    }
    assert.ok(
      ["photo.taking", "photo.failed", "photo.review", "photo.other"].every((key) =>
        SENTENCES.has(key),
      ),
    );
  });

  test("lets a photo be taken anywhere, one at a time, again after a failure", () => {
    const snap = ask({ type: "photo" }, "p1", 100);
    assert.equal(windowFor(open()).busy, false);
    assert.deepEqual(
      [windowFor({ ...open(), snap }).word, windowFor({ ...open(), snap }).busy],
      ["photo.taking", true],
    );
    const news = (status) =>
      heard(snap, { actionId: "p1", status, type: "photo", reason: "", result: {} }, 101);
    assert.equal(windowFor({ ...open(), snap: news("FINISHED") }).busy, true);
    assert.deepEqual(
      [
        windowFor({ ...open(), snap: news("FAILED") }).word,
        windowFor({ ...open(), snap: news("FAILED") }).busy,
      ],
      ["photo.failed", false],
    );
  });

  test("shows the photo to review, and is busy while an answer is sent", () => {
    assert.deepEqual(windowFor(state({ progress: review })), {
      mode: "review",
      word: "photo.review",
      photo: "p1",
      busy: false,
    });
    assert.equal(
      windowFor(
        state({
          progress: review,
          answer: { id: "a", photo: "p1", choice: "keep", at: 100, saidAt: 100 },
        }),
      ).busy,
      true,
    );
  });

  test("repeats an answer until it is confirmed", () => {
    const answer = { id: "a", photo: "p1", choice: "again", at: 100, saidAt: 100 };
    assert.deepEqual(answerAfter(answer, review, 100.5), { answer, say: false });
    assert.deepEqual(answerAfter(answer, review, 102), {
      answer: { ...answer, saidAt: 102 },
      say: true,
    });
    assert.equal(answerAfter(answer, progress({ window: "open" }), 102).answer, null);
    assert.equal(
      answerAfter({ ...answer, photo: "", choice: "skip" }, progress({ window: "open" }), 102).say,
      true,
    );
    assert.equal(
      answerAfter({ ...answer, photo: "", choice: "skip" }, progress({ window: "shut" }), 102)
        .answer,
      null,
    );
  });

  test("requests the photo until the server has it, despite errors, while wanted", async () => {
    const replies = [
      () => Promise.reject(new TypeError("no network")),
      () => Promise.reject(new Error("503")),
      async () => ({ snapshots: [{ actionId: "other", url: "/x" }] }),
      async () => ({ snapshots: [{ actionId: "p1", url: "/p1.jpg" }] }),
    ];
    const found = [];
    const asked = [];
    const waiting = [];
    const snapshots = new Snapshots({
      list: "/list",
      onFound: (...what) => found.push(what),
      fetch: (url) => (asked.push(url), replies.shift()()),
      later: (callback) => waiting.push(callback),
    });
    const settle = () => new Promise((resolve) => setImmediate(resolve));
    snapshots.want("p1");
    for (let n = 0; n < 3; n += 1) {
      await settle();
      snapshots.want("p1"); // wanting the same again asks nothing more
      waiting.shift()();
    }
    await settle();
    assert.deepEqual(found, [["p1", "/p1.jpg"]]);
    assert.equal(asked.length, 4);

    replies.push(async () => ({ snapshots: [{ actionId: "p2", url: "/p2.jpg" }] }));
    snapshots.want("p2");
    snapshots.want("");
    await settle();
    assert.equal(found.length, 1);
    assert.equal(waiting.length, 0);
  });
});

describe("what a study fixes", () => {
  test("is not offered: places, leaving the dock by itself, assistance", () => {
    const docked = state({
      robot: robot({ docked: true }),
      plan: { places: [{ name: "sofa", title: "Sofa" }] },
    });
    assert.deepEqual(offerFor(docked), { word: "dock.here_yourself", tone: "calm" });
    assert.equal(can(docked, "dock"), false);
    assert.deepEqual(menuFor(docked), []);
    const lost = state({ robot: robot({ pose: { x: 0, y: 0, theta: 0, localized: false } }) });
    assert.equal(offerFor(lost).main.action, "show_pose");
    assert.equal(isAssistFixed(docked), true);
    assert.equal(isAssistFixed(state({ study: { ...STUDY, assist: null } })), false);
  });

  test("can allow places without the map, or the map without places", () => {
    const sent = (...ownActions) =>
      state({
        study: { ...STUDY, ownActions, actions: ["goto"] },
        plan: { places: [{ name: "sofa", title: "Sofa" }] },
      });
    const goes = (one) => menuFor(one).some(({ action }) => action === "go_to:sofa");
    assert.deepEqual([goes(sent("places")), maySend(sent("places"), "map")], [true, false]);
    assert.deepEqual([goes(sent("map")), maySend(sent("map"), "map")], [false, true]);
  });

  test("offers no button out of the dock where the robot may not leave by itself", () => {
    const docked = (study) =>
      offerFor(state({ study: { ...STUDY, ...study }, robot: robot({ docked: true }) }));
    const forbidden = { actions: ["stop"], ownActions: [] };
    const byHand = docked({ ...forbidden, controllers: ["keyboard", "mouse", "touch", "stick"] });
    assert.deepEqual([byHand.word, byHand.main], ["dock.here_yourself", undefined]);
    assert.ok(SENTENCES.has(byHand.word));
    // who can only point sees nothing behind the robot to point at
    assert.equal(docked({ ...forbidden, controllers: ["mouse"] }).main.action, "back_out");
    assert.equal(docked({ ...forbidden, controllers: [] }), null);
  });

  test("follows the terms of the session, once they are known", () => {
    const terms = { controllers: ["stick"], actions: null, assist: null };
    const granted = state({}, { terms });
    assert.deepEqual(
      [
        maySteer(granted, "keyboard"),
        maySteer(granted, "stick"),
        can(granted, "undock"),
        isAssistFixed(granted),
      ],
      [false, true, true, false],
    );
  });

  test("starts with the grant and ends with the session", () => {
    const terms = { controllers: ["keyboard"], actions: [], assist: "off" };
    const granted = reduce(
      { ...newVisit(), phase: "taking", socket: "open" },
      {
        type: "session/granted",
        message: { session: "s", epoch: 1, peer: "p", limits: {}, iceServers: [], terms },
        now: 1,
      },
    ).visit;
    assert.deepEqual(granted.terms, terms);
    assert.equal(
      reduce(granted, {
        type: "session/ended",
        message: { session: "s", outcome: "completed" },
        now: 2,
      }).visit.terms,
      null,
    );
  });

  test("does not restrict visitors without a study", () => {
    const free = state({ study: null, robot: robot({ docked: true }) });
    assert.deepEqual(
      [
        maySteer(free, "keyboard"),
        maySend(free, "map"),
        isAssistFixed(free),
        offerFor(free).main.action,
      ],
      [true, true, false, "undock"],
    );
  });

  test("is explained when a visitor tries it", () => {
    assert.deepEqual(alertFor(state({ barred: { method: "keyboard", at: 99 } })), {
      word: "off.keyboard",
      tone: "busy",
    });
    assert.equal(alertFor(state({ barred: { method: "keyboard", at: 90 } })), null);
    assert.ok(
      ["off.keyboard", "off.stick", "alert.docked_forward_yourself"].every((key) =>
        SENTENCES.has(key),
      ),
    );
    assert.equal(
      alertFor(state({ robot: robot({ docked: true }), pushedAt: 99 })).word,
      "alert.docked_forward_yourself",
    );
  });

  test("keys that may not steer still stop the robot", () => {
    const [moved, stopped, barred] = [[], [], []];
    const target = new EventTarget();
    const keyboard = new Keyboard({
      keys: new KeyDispatcher({
        target,
        root: { querySelectorAll: () => [] },
        watch: () => undefined,
      }),
      emit: (shares) => moved.push(shares),
      stop: () => stopped.push(1),
      step: () => undefined,
      barred: () => barred.push(1),
      frame: () => undefined,
      now: () => 0,
    });
    keyboard.steers = false;
    keyboard.enable();
    const press = (code) => target.dispatchEvent(Object.assign(new Event("keydown"), { code }));
    press("ArrowUp");
    press("Space");
    assert.deepEqual([moved.length, barred.length, stopped.length], [0, 1, 1]);
  });
});

describe("a fixed transport of control", () => {
  const carrierOf = (only, { open = true, fresh = true } = {}) => {
    const sent = [];
    const [socket, link] = [
      { isOpen: open, send: () => sent.push("mqtt") > 0 },
      { send: () => sent.push("datachannel") > 0 },
    ];
    const commands = { velocity: () => ({ linear: 1 }), stop: () => ({ type: "stop" }) };
    const router = new TransportRouter({
      socket,
      link,
      clockSync: { isFresh: () => fresh },
      commands,
    });
    router.only = only;
    return { router, sent };
  };

  test("takes velocities and actions only, and a stop uses both", () => {
    for (const only of ["mqtt", "datachannel"]) {
      for (const state of [{}, { open: false }, { fresh: false }]) {
        const { router, sent } = carrierOf(only, state);
        router.sendVelocity(1, null);
        router.sendAction({ type: "photo" }, false);
        router.sendAction({ type: "photo" }, true);
        assert.deepEqual(sent, [only, only, only]);
        assert.equal(router.transport(1), only);
        sent.length = 0;
        router.stop(1, "stop");
        assert.deepEqual(sent, ["datachannel", "mqtt"]);
      }
    }
  });

  test("without a limit an action takes the server, and both when repeated", () => {
    const { router, sent } = carrierOf("any");
    router.sendAction({ type: "photo" }, false);
    assert.deepEqual(sent.splice(0), ["mqtt"]);
    router.sendAction({ type: "photo" }, true);
    assert.deepEqual(sent.splice(0), ["datachannel", "mqtt"]);
    const away = carrierOf("any", { open: false });
    away.router.sendAction({ type: "photo" }, false);
    assert.deepEqual(away.sent, ["datachannel", "mqtt"]);
  });
});

describe("the end of a drive", () => {
  const ended = (reason, more = {}) =>
    state({ endedAt: 100, ...more }, { phase: "ended", link: "none", session: null, reason });

  test("has words for every outcome, one button to continue, and continues by itself", () => {
    for (const reason of [...OUTCOMES, "left", "abducted"]) {
      const card = cardFor(ended(reason));
      assert.ok(
        SENTENCES.has(`${card.word}.title`) && SENTENCES.has(`${card.word}.text`),
        `${reason}: ${card.word}`,
      );
      assert.deepEqual(
        [card.main, card.other, card.countdown],
        [{ action: "go_on", word: "do.go_on" }, undefined, GO_ON_SECONDS],
      );
      assert.equal(hasEnded(ended(reason)), true);
    }
  });

  test("counts down to the next step, and not below zero", () => {
    assert.deepEqual(
      [99, 104, 200].map((now) => cardFor(ended("completed", { now })).countdown),
      [10, 6, 0],
    );
  });

  test("shows the task's outcome where it says more than the session's", () => {
    assert.equal(
      cardFor(ended("completed", { progress: progress({ outcome: "timed_out" }) })).word,
      "study.ended.timed_out",
    );
    assert.equal(
      cardFor(ended("left", { progress: progress({ outcome: "cancelled" }) })).word,
      "study.ended.left",
    );
  });

  test("does not praise a drive that was left elsewhere", () => {
    assert.equal(
      cardFor(ended("completed", { progress: progress({ passed: [1] }) })).word,
      "study.ended.left",
    );
    assert.equal(
      cardFor(ended("completed", { progress: progress({ passed: [1, 2] }) })).word,
      "study.ended.completed",
    );
    assert.equal(
      cardFor(ended("completed", { progress: progress({ outcome: "completed" }) })).word,
      "study.ended.completed",
    );
  });

  test("names the next step, at the end and before leaving", () => {
    const study = { ...STUDY, next: "Another drive is next." };
    const texts = [ended("completed", { study }), state({ study, leaving: true })].map((one) => {
      const { word, values } = cardFor(one);
      return words.say(`${word}.text`, values);
    });
    assert.ok(
      texts.every((text) => text.endsWith(study.next)),
      String(texts),
    );
  });

  test("of practice leads to the study, and not to questions", () => {
    const practice = { ...STUDY, kind: "practice" };
    assert.equal(cardFor(ended("timed_out", { study: practice })).word, "practice.ended");
    assert.equal(
      cardFor(ended("robot_fault", { study: practice })).word,
      "study.ended.robot_fault",
    );
    assert.ok(
      [
        "practice.ended.title",
        "practice.ended.text",
        "practice.leaving.title",
        "practice.leaving.text",
      ].every((key) => SENTENCES.has(key)),
    );
  });

  test("is not reached by a moved session or a missed turn", () => {
    assert.equal(cardFor(ended("moved")).main.action, "ask_to_take_over");
    assert.equal(cardFor(ended("turn_missed")).main.action, "drive");
    assert.equal(hasEnded(ended("moved")), false);
  });

  test("is confirmed: leaving warns that the task cannot be resumed", () => {
    const card = cardFor(state({ leaving: true }));
    assert.deepEqual(
      [card.word, card.main.action, card.other.action],
      ["study.leaving", "leave_now", "stay"],
    );
    assert.ok(SENTENCES.has("study.leaving.title") && SENTENCES.has("study.leaving.text"));
  });

  test("no card of a study leads to another robot, and each has a button", () => {
    const visits = [
      ...["connecting", "lobby", "taking", "queued", "turn", "elsewhere"].map((phase) => ({
        phase,
        link: "none",
      })),
      { phase: "lobby", mayDrive: false },
      ...[
        "offline",
        "disabled",
        "not_invited",
        "not_trained",
        "observers_full",
        "not_allowed",
        "paused",
      ].map((reason) => ({ phase: "refused", reason })),
    ];
    for (const visit of visits) {
      const card = cardFor(state({}, visit));
      const actions = [card.main, card.other].filter(Boolean).map(({ action }) => action);
      assert.ok(
        !actions.some((action) => ["home", "watch", "back"].includes(action)),
        `${visit.phase} ${actions}`,
      );
      assert.ok(actions.length > 0 || card.busy, visit.phase);
    }
  });
});

describe("announcements of the task", () => {
  test("come at most every few seconds, only the last of several", () => {
    const announcerQueue = new AnnouncerQueue();
    assert.equal(announcerQueue.hear("Go to 1", 100), "Go to 1");
    assert.deepEqual(
      [
        announcerQueue.hear("turn left", 101),
        announcerQueue.hear("turn right", 102),
        announcerQueue.hear("ready", 103),
      ],
      [null, null, null],
    );
    assert.equal(announcerQueue.hear("ready", 104.5), "ready");
    assert.equal(announcerQueue.hear("ready", 200), null);
  });

  test("have the time left in few steps", () => {
    assert.deepEqual([null, 300, 120, 61, 60, 31, 12, 9].map(roundLeft), [
      null,
      null,
      120,
      120,
      60,
      60,
      30,
      10,
    ]);
  });
});

describe("the page's record", () => {
  test("has each sentence with its duration, without those too short to read", () => {
    const shown = new Shown("cue_shown");
    assert.equal(shown.hear("cue.go_to_checkpoint", 1, 10), null);
    assert.equal(shown.hear("cue.go_to_checkpoint", 1, 12), null);
    assert.deepEqual(shown.hear("cue.go_to_checkpoint", 2, 13.5), {
      type: "cue_shown",
      data: { word: "cue.go_to_checkpoint", number: 1, seconds: 3.5 },
    });
    assert.equal(shown.hear("", null, 13.6), null);
    assert.equal(shown.hear("cue.lost", 2, 20), null);
  });

  test("has changes once, and everything again when a session starts", () => {
    const map = new Changes("map");
    assert.deepEqual(map.hear({ open: true }), { type: "map", data: { open: true } });
    assert.equal(map.hear({ open: true }), null);
    map.reset();
    assert.deepEqual(map.hear({ open: true }), { type: "map", data: { open: true } });
  });

  test("names the layout that the style sheet chooses", () => {
    assert.deepEqual(
      [
        [1280, 800],
        [390, 844],
        [844, 390],
        [999, 1000],
        [1280, 500],
      ].map(([width, height]) => layoutOf(width, height)),
      ["wide", "upright", "low", "upright", "low"],
    );
  });
});
