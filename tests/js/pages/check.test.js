import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { describe, test } from "node:test";

import { appOf, browserFor } from "../../../static/js/pages/check/in_app.js";
import { advice, forRecord, judge, overall } from "../../../static/js/pages/check/verdict.js";
import { isRobotsFault } from "../../../static/js/waiting/fault.js";
import { cardFor } from "../../../static/js/view/hud/card.js";
import { newVisit } from "../../../static/js/protocol/session.js";
import { newState } from "../../../static/js/drive/features.js";

const TEMPLATE = readFileSync(
  new URL("../../../templates/sessions/_check_words.html", import.meta.url),
  "utf8",
);
const SENTENCES = new Map(
  Array.from(
    TEMPLATE.matchAll(/data-word="([^"]+)">\{% translate "(.*)" %\}<\/p>/g),
    ([, key, sentence]) => [key, sentence],
  ),
);
const STUN = [{ urls: ["stun:a.example"] }];
const TURN = [
  { urls: "stun:a.example" },
  { urls: ["turn:a.example?transport=udp"], username: "u", credential: "c" },
];
const FOUND = {
  reached: true,
  roundTrip: 0.02,
  live: true,
  app: "",
  codecs: ["video/VP8"],
  ways: ["host", "srflx"],
  microphone: "there",
  camera: "there",
  gamepad: "",
};
const IN_WORDS = (changes, servers = STUN) =>
  Object.fromEntries(
    judge({ ...FOUND, ...changes }, servers).map(({ topic, word }) => [
      topic,
      word.split(".").at(-1),
    ]),
  );

describe("the check of browser and network", () => {
  test("finds no problem with a good connection", () => {
    const lines = judge(FOUND, STUN);
    assert.deepEqual(
      lines.filter(({ mark }) => mark !== "good").map(({ topic }) => topic),
      ["gamepad"],
    );
    assert.deepEqual([overall(lines), advice(lines)], ["good", null]);
  });

  test("tells a blocked connection from a relayed one, and from no network", () => {
    assert.equal(IN_WORDS({ ways: ["host"] }).way, "blocked");
    assert.equal(IN_WORDS({ ways: ["host", "relay"] }, TURN).way, "detour");
    assert.equal(IN_WORDS({ ways: [] }, TURN).way, "none");
    assert.equal(IN_WORDS({ ways: ["host"] }, []).way, "unknown");
  });

  test("mentions a relay only where the site has one", () => {
    assert.equal(IN_WORDS({}).detour, undefined);
    assert.equal(IN_WORDS({}, TURN).detour, "none");
    assert.equal(IN_WORDS({ ways: ["srflx", "relay"] }, TURN).detour, "there");
  });

  test("calls a slow server slow, and a WebSocket that does not open blocked", () => {
    assert.equal(IN_WORDS({ roundTrip: 0.5 }).server, "slow");
    assert.equal(IN_WORDS({ reached: false, roundTrip: null }).server, "blocked");
  });

  test("tells who can drive, drive with slow video, or not at all", () => {
    const verdict = (changes) => overall(judge({ ...FOUND, ...changes }, STUN));
    assert.equal(verdict({ ways: ["host"] }), "slow");
    assert.equal(verdict({ live: false, ways: [], codecs: [] }), "slow");
    assert.equal(verdict({ reached: false, roundTrip: null }), "bad");
    assert.equal(verdict({ microphone: "blocked", camera: "none" }), "good");
  });

  test("tells whether an app's browser lacks live video, and checks no more", () => {
    const none = { live: false, ways: [], codecs: [] };
    assert.deepEqual([IN_WORDS(none).browser, IN_WORDS(none).way], ["off", undefined]);
    assert.equal(IN_WORDS({ ...none, app: "WeChat" }).browser, "in_app");
  });

  test("needs one of the robots' two video formats, where the browser names any", () => {
    assert.equal(IN_WORDS({ codecs: ["video/AV1"] }).picture, "none");
    assert.equal(IN_WORDS({ codecs: ["video/h264"] }).picture, "there");
    assert.equal(IN_WORDS({ codecs: [] }).picture, "there");
  });

  test("gives the most important advice", () => {
    assert.equal(
      advice(judge({ ...FOUND, roundTrip: 0.5, ways: ["host"] }, STUN)).word,
      "check.way.blocked",
    );
    assert.equal(advice(judge({ ...FOUND, roundTrip: 0.5 }, STUN)).word, "check.server.slow");
  });

  test("does not call blocked what the page itself reaches", () => {
    const lines = judge({ ...FOUND, reached: false, roundTrip: null, ways: ["host"] }, STUN);
    assert.equal(advice(lines).word, "check.server.blocked");
    assert.equal(advice(lines, true).word, "check.way.blocked");
    assert.equal(advice(judge({ ...FOUND, reached: false, roundTrip: null }, STUN), true), null);
  });

  test("fits into a page event: few fields, plain values", () => {
    const record = forRecord(judge({ ...FOUND, app: "LINE", live: false }, TURN), {
      ...FOUND,
      app: "LINE",
    });
    assert.ok(Object.keys(record).length <= 16);
    assert.ok(
      Object.values(record).every(
        (value) => value === null || ["string", "number"].includes(typeof value),
      ),
    );
    assert.deepEqual([record.browser, record.overall, record.app], ["in_app", "slow", "LINE"]);
  });

  test("has a sentence of at most twenty words for everything, without protocol names", () => {
    const some = [
      { ...FOUND, gamepad: "Pad" },
      { ...FOUND, reached: false, roundTrip: null },
      { ...FOUND, roundTrip: 1 },
      { ...FOUND, live: false },
      { ...FOUND, live: false, app: "X" },
      { ...FOUND, codecs: ["video/AV1"] },
    ];
    const ways = [["host"], ["host", "relay"], [], ["srflx", "relay"]].flatMap((kinds) =>
      [STUN, TURN, []].map((servers) => [{ ...FOUND, ways: kinds }, servers]),
    );
    const devices = ["there", "none", "blocked", "barred"].map((state) => ({
      ...FOUND,
      microphone: state,
      camera: state,
    }));
    const lines = [...[...some, ...devices].map((found) => [found, TURN]), ...ways].flatMap(
      ([found, servers]) => judge(found, servers),
    );
    for (const { topic, mark, word } of lines) {
      assert.deepEqual(
        [`check.topic.${topic}`, `check.mark.${mark}`, word].filter((key) => !SENTENCES.has(key)),
        [],
      );
    }
    for (const [key, sentence] of SENTENCES) {
      assert.ok(sentence.split(/\s+/).length <= 20, key);
      assert.doesNotMatch(sentence, /\b(WebRTC|ICE|STUN|TURN|UDP|MQTT|WebSocket|session|lease)\b/);
    }
  });
});

describe("browsers inside apps", () => {
  const IPHONE =
    "Mozilla/5.0 (iPhone; CPU iPhone OS 17_5 like Mac OS X) AppleWebKit/605.1.15" +
    " (KHTML, like Gecko) Mobile/15E148";
  const ANDROID =
    "Mozilla/5.0 (Linux; Android 14; Pixel 8; wv) AppleWebKit/537.36" +
    " (KHTML, like Gecko) Version/4.0 Chrome/126.0 Mobile Safari/537.36";

  test("are known by their names, and other browsers are not mistaken for them", () => {
    assert.equal(appOf(`${IPHONE} Instagram 334.0.4.32.98 (iPhone15,2; iOS 17_5)`), "Instagram");
    assert.equal(appOf(`${IPHONE} [FBAN/FBIOS;FBAV/468.0]`), "Facebook");
    assert.equal(appOf(`${IPHONE} MicroMessenger/8.0.49(0x1800312b)`), "WeChat");
    assert.equal(appOf(ANDROID), "app");
    assert.equal(appOf(`${IPHONE} Version/17.5 Safari/604.1`), "");
    assert.equal(
      appOf("Mozilla/5.0 (X11; Linux x86_64; rv:128.0) Gecko/20100101 Firefox/128.0"),
      "",
    );
  });

  test("name the browser of the device", () => {
    assert.deepEqual([browserFor(IPHONE), browserFor(ANDROID)], ["Safari", "Chrome"]);
  });

  test("get a link to copy, and may drive with slow video", () => {
    const state = (more = {}) => ({
      ...newState(),
      betterBrowser: "Safari",
      ...more,
      visit: { ...newVisit(), phase: "closed", reason: "in_app" },
    });
    const card = cardFor(state());
    assert.deepEqual(
      [card.values.browser, card.main.action, card.extra.action],
      ["Safari", "copy_link", "go_slow"],
    );
    assert.equal(cardFor(state({ copied: true })).main.word, "do.link_copied");
  });
});

describe("a robot that disconnects", () => {
  const state = (more = {}, visit = {}) => ({
    ...newState(),
    ...more,
    visit: { ...newVisit(), phase: "driving", online: true, ...visit },
  });
  const robot = (errors, inhibited = null) => ({ errors, safety: { estop: false, inhibited } });

  test("is no problem of the visitor's network, whichever part has failed", () => {
    assert.equal(isRobotsFault(state({ robot: robot([]) })), false);
    assert.equal(isRobotsFault(state({}, { online: false })), true);
    assert.equal(isRobotsFault(state({ faults: [{ part: "robot", then: "stopped" }] })), true);
    assert.equal(isRobotsFault(state({ robot: robot(["adapter_lost: it died"], "fault") })), true);
    const starting = { ...robot([]), cameraStatus: { status: "starting", reason: "" } };
    assert.equal(isRobotsFault(state({ robot: starting })), true);
    assert.equal(isRobotsFault(state({ faults: [{ part: "broker", then: "waits" }] })), false);
  });
});

describe("a missing connection", () => {
  test("is explained on the cards of waiting and of the end", () => {
    const finding = { word: "check.way.blocked", values: {} };
    const card = (visit) =>
      cardFor({
        ...newState(),
        finding,
        visit: { ...newVisit(), socket: "open", online: true, ...visit },
      });
    assert.equal(card({ phase: "driving", link: "connecting" }).detail, finding);
    assert.equal(card({ phase: "driving", link: "lost" }).detail, finding);
    assert.equal(card({ phase: "connecting", socket: "lost" }).detail, finding);
    assert.equal(card({ phase: "ended", reason: "connection_refused" }).detail, finding);
    assert.equal(card({ phase: "ended", reason: "left" }).detail, null);
  });
});
