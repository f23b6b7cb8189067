import assert from "node:assert/strict";
import { describe, test } from "node:test";

import { newVisit } from "../../../static/js/protocol/session.js";
import { alertFor } from "../../../static/js/view/hud/alert.js";
import { createWakeLock } from "../../../static/js/view/display/wake_lock.js";
import { createFullScreen } from "../../../static/js/view/display/full_screen.js";
import { showsLaser } from "../../../static/js/autonomy/map_bar.js";
import {
  PROFILES,
  beginningOf,
  fixedProfile,
  nameOf,
  profileOf,
} from "../../../static/js/view/display/profiles.js";
import { recallProfile, rememberProfile } from "../../../static/js/lib/storage.js";
import { newState } from "../../../static/js/drive/features.js";
import { Figures, pickMore, pathKindOf } from "../../../static/js/view/technical/figures.js";

const ROBOT = {
  safety: { estop: false, inhibited: null, collision: false },
  assist: "steer",
  docked: false,
  refused: {},
  velocity: { linear: -0.25 },
};
const state = (more = {}, visit = {}) => ({
  ...newState(),
  robot: ROBOT,
  ...more,
  visit: { ...newVisit(), phase: "driving", link: "live", online: true, socket: "open", ...visit },
});
const settled = () => new Promise((resolve) => setImmediate(resolve));

describe("the profile in force", () => {
  test("is the study's, else the visitor's, else the standard one", () => {
    assert.equal(nameOf(state()), "standard");
    assert.equal(nameOf(state({ profile: "technical" })), "technical");
    assert.equal(nameOf(state({ profile: "technical", study: { interface: "expert" } })), "expert");
    assert.equal(
      nameOf(
        state(
          { profile: "technical", study: { interface: "expert" } },
          { terms: { interface: "novice" } },
        ),
      ),
      "novice",
    );
  });

  test("is the visitor's where the terms leave it open", () => {
    assert.equal(fixedProfile(state({ profile: "expert" }, { terms: { interface: "" } })), null);
    assert.equal(nameOf(state({ profile: "expert" }, { terms: { interface: "" } })), "expert");
    assert.equal(nameOf(state({ profile: "expert", study: { interface: null } })), "expert");
  });

  test("is recorded as shown when its name is unknown", () => {
    assert.equal(nameOf(state({}, { terms: { interface: "plain" } })), "standard");
    assert.equal(nameOf(state({ profile: "toString" })), "standard");
    assert.equal(profileOf(state({ profile: "hasOwnProperty" })), PROFILES.standard);
  });

  test("starts a drive with its speed, and its assistance if it can be chosen", () => {
    const able = { factsheet: { capabilities: ["assist"] } };
    assert.deepEqual(beginningOf(state({ ...able, profile: "novice" }), false), {
      step: 0,
      assist: "steer",
    });
    assert.deepEqual(beginningOf(state({ ...able, profile: "expert" }), false), {
      step: 2,
      assist: "slow",
    });
    assert.deepEqual(beginningOf(state({ ...able, profile: "technical" }), false), {
      step: 1,
      assist: "off",
    });
    assert.deepEqual(beginningOf(state(able), false), { step: 1, assist: null }, "the owner's");
    assert.equal(beginningOf(state({ profile: "novice" }), false).assist, null, "a robot without");
    assert.equal(
      beginningOf(state({ ...able, profile: "novice" }), true).assist,
      null,
      "it goes on",
    );
    assert.equal(
      beginningOf(
        state({ ...able, profile: "novice" }, { terms: { assist: "off", interface: "" } }),
        false,
      ).assist,
      null,
      "a study's",
    );
  });

  test("draws the laser points, or not, unless the visitor chose otherwise", () => {
    assert.equal(showsLaser(state()), true, "the robot assists");
    assert.equal(showsLaser(state({ profile: "novice" })), false);
    assert.equal(showsLaser(state({ profile: "novice", laser: true })), true);
    assert.equal(
      showsLaser(state({ profile: "technical", robot: { ...ROBOT, assist: "off" } })),
      true,
    );
  });

  test("explains assistance or not, and always why the robot does not move", () => {
    const helped = (profile, why) =>
      alertFor(state({ profile, help: { why, side: "left", point: [1, 1] } }))?.word;
    assert.equal(helped("novice", "steer"), "assist.steer.left");
    for (const profile of ["expert", "technical"]) {
      assert.equal(helped(profile, "steer"), undefined);
      assert.equal(helped(profile, "stop"), "assist.stop.left");
      assert.equal(alertFor(state({ profile, stuck: { word: "stuck.late" } })).word, "stuck.late");
    }
  });
});

describe("the browser's storage of a person", () => {
  test("has the profile, separately for each user, and may be forbidden", () => {
    const kept = new Map();
    globalThis.localStorage = {
      getItem: (key) => kept.get(key) ?? null,
      setItem: (key, value) => kept.set(key, value),
    };
    rememberProfile("Ana", "expert");
    assert.equal(recallProfile("Ana"), "expert");
    assert.equal(recallProfile("Bert"), null);
    globalThis.localStorage.getItem = globalThis.localStorage.setItem = () => {
      throw new DOMException("no", "SecurityError");
    };
    rememberProfile("Ana", "novice");
    assert.equal(recallProfile("Ana"), null);
    delete globalThis.localStorage;
  });
});

describe("the wake lock", () => {
  const browser = ({ refuses = false } = {}) => {
    const document = Object.assign(new EventTarget(), { visibilityState: "visible" });
    const given = [];
    const request = async () => {
      if (refuses) {
        throw new DOMException("battery", "NotAllowedError");
      }
      const lock = { released: false, release: async () => (lock.released = true) };
      given.push(lock);
      return lock;
    };
    const see = (visibilityState) => {
      Object.assign(document, { visibilityState });
      document.dispatchEvent(new Event("visibilitychange"));
    };
    return { document, given, see, locks: { request } };
  };

  test("is held during a drive, again after the page was hidden, and no longer", async () => {
    const { given, see, ...rest } = browser();
    const keep = createWakeLock(rest);
    keep(true);
    keep(true);
    await settled();
    assert.equal(given.length, 1);
    given[0].released = true; // the browser takes it with the hiding
    see("hidden");
    await settled();
    assert.equal(given.length, 1);
    see("visible");
    await settled();
    assert.equal(given.length, 2);
    keep(false);
    await settled();
    assert.ok(given[1].released);
    see("visible");
    await settled();
    assert.equal(given.length, 2);
  });

  test("is released when a drive ends while the browser still decides", async () => {
    const { given, ...rest } = browser();
    const keep = createWakeLock(rest);
    keep(true);
    keep(false);
    await settled();
    assert.deepEqual(
      given.map(({ released }) => released),
      [true],
    );
  });

  test("may be refused or missing", async () => {
    const { see, ...rest } = browser({ refuses: true });
    const keep = createWakeLock(rest);
    keep(true);
    await settled();
    see("visible");
    await settled();
    createWakeLock({ ...browser(), locks: undefined })(true);
    await settled();
  });
});

describe("full screen", () => {
  const make = (names) => {
    const document = Object.assign(new EventTarget(), { documentElement: {} });
    document.documentElement[names.enter] = () => {
      document[names.element] = document.documentElement;
      document.dispatchEvent(new Event(names.event));
    };
    document[names.exit] = () => {
      document[names.element] = null;
      document.dispatchEvent(new Event(names.event));
    };
    return document;
  };
  const TODAY = {
    enter: "requestFullscreen",
    exit: "exitFullscreen",
    element: "fullscreenElement",
    event: "fullscreenchange",
  };
  const PREFIXED = {
    enter: "webkitRequestFullscreen",
    exit: "webkitExitFullscreen",
    element: "webkitFullscreenElement",
    event: "webkitfullscreenchange",
  };

  for (const names of [TODAY, PREFIXED]) {
    test(`is left by the button or by Escape, which the page tells apart (${names.enter})`, () => {
      const document = make(names);
      const left = [];
      const screen = createFullScreen({ document, onLeft: (byButton) => left.push(byButton) });
      assert.ok(screen.exists);
      screen.toggle();
      assert.ok(screen.isOn());
      screen.toggle();
      screen.toggle();
      document[names.exit](); // what the browser does on Escape
      assert.deepEqual(left, [true, false]);
    });
  }

  test("is not offered where the browser has none for pages", () => {
    assert.equal(
      createFullScreen({
        document: Object.assign(new EventTarget(), { documentElement: {} }),
        onLeft: () => undefined,
      }).exists,
      false,
    );
  });
});

describe("the figures of the connection", () => {
  const report = (n, more = {}) => [
    {
      id: "v",
      type: "inbound-rtp",
      kind: "video",
      timestamp: 500 * n,
      framesDecoded: 15 * n,
      packetsReceived: 90 * n,
      packetsLost: 10 * n,
      bytesReceived: 62_500 * n,
      jitter: 0.004,
      freezeCount: 2,
      totalFreezesDuration: 1.25,
      codecId: "c",
      ...more,
    },
    { id: "c", type: "codec", mimeType: "video/VP8" },
    { id: "t", type: "transport", selectedCandidatePairId: "p" },
    { id: "p", type: "candidate-pair", localCandidateId: "l" },
    { id: "l", type: "local-candidate", candidateType: "host", protocol: "udp" },
  ];
  const raw = (more = {}) => ({
    connection: CONNECTION,
    state: state(),
    trips: { datachannel: 0.0124, mqtt: null },
    glass: 0.031,
    size: [640, 480],
    ...more,
  });
  const CONNECTION = {};
  const shown = (rows) => Object.fromEntries(rows.map(({ key, value }) => [key, value]));
  const read = (figures, count, more) => {
    let rows = [];
    for (let n = 1; n <= count; n += 1) {
      rows = figures.read(raw(more), report(n));
    }
    return shown(rows);
  };

  test("are taken over a second, with the robot's own", () => {
    const robot = {
      ...ROBOT,
      applied: [{ age: 0.02 }, { age: 0.0456, frameAge: 0.087 }],
      refused: { stale: 2, future: 1 },
    };
    const now = read(new Figures((way) => `<${way}>`, "en"), 5, { state: state({ robot }) });
    assert.deepEqual(now, {
      fps: "30",
      glass: "31",
      trip_direct: "12",
      trip_server: "–",
      age: "46",
      loop: "87",
      refused: "3",
      loss: "10.0",
      jitter: "4",
      rate: "1000",
      freezes: "2 (1.3 s)",
      size: "640×480 VP8",
      path: "<direct>, udp",
    });
  });

  test("are a dash while unknown, never a zero", () => {
    const now = shown(
      new Figures(String, "en").read(
        raw({
          connection: null,
          state: state({ robot: null }),
          trips: { datachannel: null, mqtt: null },
          glass: null,
          size: [0, 0],
        }),
        null,
      ),
    );
    assert.deepEqual([...new Set(Object.values(now))], ["–"]);
  });

  test("keep the age of the last command after its release", () => {
    const figures = new Figures(String, "en");
    figures.read(
      raw({ state: state({ robot: { ...ROBOT, applied: [{ age: 0.02 }] } }) }),
      report(1),
    );
    assert.equal(
      shown(figures.read(raw({ state: state({ robot: { ...ROBOT, applied: [] } }) }), report(2)))
        .age,
      "20",
    );
  });

  test("use the median delay, so that one late frame changes nothing", () => {
    const figures = new Figures(String, "en");
    const read = (glass, n) => shown(figures.read(raw({ glass }), report(n))).glass;
    assert.deepEqual([0.03, 0.031, 0.4, 0.03].map(read), ["30", "31", "31", "31"]);
  });

  test("start again with another connection", () => {
    const figures = new Figures(String, "en");
    read(figures, 3);
    const now = shown(figures.read(raw({ connection: {} }), report(1)));
    assert.deepEqual([now.fps, now.size], ["–", "640×480 VP8"]);
  });

  test("have their own sources for frames through the server", () => {
    const network = { fps: 4, bitrate: 800_000, path: "server/jpeg" };
    const now = shown(
      new Figures((way) => way, "es").read(
        raw({ connection: null, state: state({ slow: true, network }), glass: null }),
        null,
      ),
    );
    assert.deepEqual(
      [now.fps, now.rate, now.path, now.size, now.freezes],
      ["4", "800", "server, jpeg", "640×480 JPEG", "–"],
    );
  });

  test("are written in the visitor's language", () => {
    const now = read(new Figures(String, "es"), 5);
    assert.deepEqual([now.loss, now.freezes, now.rate], ["10,0", "2 (1,3 s)", "1000"]);
  });

  test("a path is direct, by a relay, or through the server", () => {
    assert.deepEqual(
      ["host/udp", "srflx/udp", "relay/tcp", "server/jpeg", "", undefined].map(pathKindOf),
      ["direct", "direct", "relay", "server", "", ""],
    );
  });

  test("work in browsers without codec and freezes", () => {
    assert.deepEqual(pickMore([]), { codec: "", freezes: 0, frozen: 0 });
  });
});
