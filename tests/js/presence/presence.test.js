import assert from "node:assert/strict";
import { describe, test } from "node:test";

import { Devices, troubleOf } from "../../../static/js/presence/devices.js";
import {
  callOf,
  isHeard,
  mustSay,
  newOwn,
  noteOf,
  previewOf,
} from "../../../static/js/presence/call.js";
import { KeyDispatcher } from "../../../static/js/input/key_dispatcher.js";
import { PushToTalk } from "../../../static/js/presence/push_to_talk.js";
import { Tilting } from "../../../static/js/presence/tilt.js";
import { sceneFor, titleOf } from "../../../static/js/pages/screen/scene.js";
import { createVoice } from "../../../static/js/pages/screen/speech.js";

const own = (changes = {}) => ({ ...newOwn(), ...changes });
const accepted = { status: "accepted", audio: true, video: true, volume: 1 };

describe("what is sent", () => {
  test("nothing is sent, and no call is requested, before a click", () => {
    assert.equal(callOf(own()), null);
    assert.equal(isHeard(own({ talking: true })), false);
    assert.equal(noteOf(own(), null, 0), "");
    assert.equal(mustSay(own(), null), false);
  });

  test("a muted visitor is heard only while the key is down", () => {
    assert.equal(isHeard(own({ mic: "muted" })), false);
    assert.equal(isHeard(own({ mic: "muted", talking: true })), true);
    assert.equal(isHeard(own({ mic: "on" })), true);
  });

  test("the call is requested until the robot's state has it, and again if it is lost", () => {
    const wanted = own({ mic: "on", camera: "on" });
    assert.equal(mustSay(wanted, null), true);
    assert.equal(mustSay(wanted, accepted), false);
    assert.equal(mustSay({ ...wanted, volume: 0.5 }, accepted), true);
    assert.equal(mustSay(own(), accepted), true);
    assert.equal(mustSay(own({ mic: "on" }), accepted), true);
  });

  test("the page shows what is sent, and what is not", () => {
    assert.equal(noteOf(own({ mic: "on", camera: "on" }), accepted, 1), "presence.both");
    assert.equal(noteOf(own({ camera: "on" }), accepted, 1), "presence.seen");
    assert.equal(noteOf(own({ camera: "on", mic: "muted" }), accepted, 1), "presence.seen_muted");
    assert.equal(noteOf(own({ mic: "on" }), accepted, 1), "presence.heard");
    assert.equal(noteOf(own({ mic: "muted" }), accepted, 1), "presence.muted");
    assert.equal(
      noteOf(own({ mic: "on" }), { ...accepted, status: "ringing" }, 1),
      "presence.ringing",
    );
    assert.equal(
      noteOf(own({ mic: "on" }), { ...accepted, status: "ringing" }, 0),
      "presence.screen_off",
    );
    assert.equal(
      noteOf(own({ mic: "on" }), { ...accepted, status: "unanswered" }, 1),
      "presence.unanswered",
    );
    assert.equal(noteOf(own({ turnedAway: true }), null, 1), "presence.declined");
    assert.equal(noteOf(own({ camera: "asking" }), null, 1), "presence.asking");
  });
});

describe("the visitor counts as seen and heard only when the robot confirms it", () => {
  const both = own({ mic: "on", camera: "on" });
  /** @param {boolean} shown @param {boolean} audible */
  const call = (shown, audible, status = "accepted") => ({
    ...accepted,
    status,
    shown,
    audible,
  });

  test("by a display that shows the video and may play sound", () => {
    assert.equal(noteOf(both, call(true, true), 1), "presence.both");
    assert.equal(noteOf(both, call(true, false), 1), "presence.unheard");
    assert.equal(noteOf(both, call(false, true), 1), "presence.unseen");
    assert.equal(noteOf(own({ mic: "on" }), call(false, false), 1), "presence.unheard");
    assert.equal(noteOf(own({ mic: "on" }), call(false, true), 1), "presence.heard");
    assert.equal(noteOf(own({ mic: "muted" }), call(false, false), 1), "presence.muted");
    const shares = own({ camera: "on", shares: true });
    assert.equal(noteOf(shares, call(false, false), 1), "presence.unseen");
    assert.equal(noteOf(shares, call(true, false), 1), "presence.shared");
  });

  test("by its own loudspeaker and display", () => {
    assert.equal(noteOf(both, call(true, true), 0), "presence.both");
    assert.equal(noteOf(both, call(false, true), 0, false), "presence.unseen");
    assert.equal(noteOf(both, call(true, false), 0, false), "presence.unheard");
  });

  test("and not without a display, which may be off or not exist", () => {
    for (const status of ["accepted", "ringing"]) {
      assert.equal(noteOf(both, call(false, false, status), 0), "presence.screen_off");
      assert.equal(noteOf(both, call(false, false, status), 0, false), "presence.no_screen");
    }
    const older = { ...accepted, shown: null, audible: null };
    assert.equal(noteOf(both, older, 0), "presence.screen_off");
    assert.equal(noteOf(both, older, 1), "presence.both");
  });
});

describe("a shared screen", () => {
  const track = () =>
    Object.assign(new EventTarget(), {
      stopped: 0,
      stop() {
        this.stopped += 1;
      },
    });
  const stream = (one) => ({ getTracks: () => [one] });

  test("replaces the camera until it ends, also by the browser's button", async () => {
    const [camera, screen] = [track(), track()];
    const lost = [];
    const devices = new Devices({
      onLost: (kind) => lost.push(kind),
      media: {
        getUserMedia: async () => stream(camera),
        getDisplayMedia: async () => stream(screen),
      },
    });
    await devices.open("video");
    assert.ok(devices.canShare);
    assert.equal(await devices.share(), true);
    assert.deepEqual(
      [camera.stopped, devices.tracks.video === screen, screen.contentHint],
      [1, true, "text"],
    );
    camera.dispatchEvent(new Event("ended"));
    assert.deepEqual(lost, []);
    screen.dispatchEvent(new Event("ended"));
    assert.deepEqual([lost, devices.tracks.video], [["video"], null]);
  });

  test("that the visitor cancels leaves the camera as it is", async () => {
    const camera = track();
    const refused = () =>
      Promise.reject(Object.assign(new Error("no"), { name: "NotAllowedError" }));
    const devices = new Devices({
      onLost: () => undefined,
      media: { getUserMedia: async () => stream(camera), getDisplayMedia: refused },
    });
    await devices.open("video");
    assert.equal(await devices.share(), false);
    assert.deepEqual([camera.stopped, devices.tracks.video === camera], [0, true]);
  });

  test("is not offered where the browser has none, and its note appears once it is seen", () => {
    assert.equal(new Devices({ onLost: () => undefined, media: {} }).canShare, false);
    assert.equal(noteOf(own({ camera: "on", shares: true }), accepted, 1), "presence.shared");
    assert.equal(
      noteOf(own({ camera: "on", shares: true, mic: "on" }), accepted, 1),
      "presence.shared_heard",
    );
    assert.equal(
      noteOf(own({ camera: "on", shares: true }), { ...accepted, status: "ringing" }, 1),
      "presence.ringing",
    );
    assert.deepEqual(callOf(own({ camera: "on", shares: true })), {
      ringing: true,
      audio: false,
      video: true,
      volume: 1,
      shares: true,
    });
  });
});

describe("the preview of a shared screen", () => {
  const shared = own({ camera: "on", shares: true });
  const seen = { ...accepted, shares: true };

  test("is shown while people see it, and takes pointers where the robot shows them", () => {
    assert.deepEqual(previewOf(shared, seen, 1), { seen: true, points: true });
    assert.deepEqual(previewOf(shared, seen, 0), { seen: true, points: false });
    assert.deepEqual(previewOf(shared, { ...seen, status: "ringing" }, 1), {
      seen: false,
      points: false,
    });
    assert.deepEqual(previewOf(shared, { ...seen, video: false }, 1), {
      seen: false,
      points: false,
    });
    assert.deepEqual(previewOf(shared, null, 1), { seen: false, points: false });
    assert.deepEqual(previewOf(own({ camera: "on" }), seen, 1), { seen: false, points: false });
  });

  test("takes no pointers while the robot treats it as a face", () => {
    assert.deepEqual(previewOf(shared, accepted, 1), { seen: true, points: false });
    const heard = { ...accepted, audio: false };
    assert.equal(mustSay(shared, { ...heard, shares: false }, true), true);
    assert.equal(mustSay(shared, { ...heard, shares: true }, true), false);
    assert.equal(mustSay(shared, { ...heard, shares: false }, false), false);
    assert.equal(mustSay(own({ camera: "on" }), { ...heard, shares: true }, true), true);
  });
});

describe("microphone and camera", () => {
  const media = (answer) => ({ getUserMedia: async (wanted) => answer(wanted) });
  const failing = (name) => media(() => Promise.reject(Object.assign(new Error(name), { name })));

  test("every refusal of a browser has its own advice", async () => {
    for (const [name, why] of [
      ["NotAllowedError", "refused"],
      ["NotFoundError", "missing"],
      ["NotReadableError", "busy"],
      ["AbortError", "busy"],
      ["TypeError", "unsupported"],
    ]) {
      assert.equal(troubleOf(name), why);
      assert.equal(
        await new Devices({ onLost: () => undefined, media: failing(name) }).open("audio"),
        why,
      );
      assert.equal(
        noteOf(own({ trouble: { kind: "video", why } }), null, 0),
        `presence.video.${why}`,
      );
    }
    assert.equal(
      await new Devices({ onLost: () => undefined, media: undefined }).open("video"),
      "unsupported",
    );
  });

  test("opens only what was clicked; closing is no loss, and unplugging is one", async () => {
    const asked = [];
    const lost = [];
    const track = Object.assign(new EventTarget(), {
      stopped: 0,
      stop() {
        this.stopped += 1;
      },
    });
    const devices = new Devices({
      onLost: (kind) => lost.push(kind),
      media: media((wanted) => {
        asked.push(Object.keys(wanted));
        return { getTracks: () => [track] };
      }),
    });
    assert.equal(await devices.open("audio"), null);
    assert.deepEqual(asked, [["audio"]]);
    devices.close("audio");
    track.dispatchEvent(new Event("ended"));
    assert.deepEqual([track.stopped, lost], [1, []]);
    await devices.open("video");
    track.dispatchEvent(new Event("ended"));
    assert.deepEqual([lost, devices.tracks.video], [["video"], null]);
  });
});

describe("push to talk", () => {
  const key = (type, fields = {}) =>
    Object.assign(new Event(type), { code: "KeyT", repeat: false, ...fields });

  test("T opens the microphone until it is released or the window loses the focus", () => {
    const target = new EventTarget();
    const talk = [];
    const keys = new KeyDispatcher({
      target,
      root: { querySelectorAll: () => [] },
      watch: () => undefined,
    });
    keys.addCommands({ talk: new PushToTalk((down) => talk.push(down)) });
    target.dispatchEvent(key("keydown"));
    target.dispatchEvent(key("keydown", { repeat: true }));
    target.dispatchEvent(key("keyup"));
    target.dispatchEvent(key("keydown"));
    target.dispatchEvent(new Event("blur"));
    target.dispatchEvent(key("keyup"));
    assert.deepEqual(talk, [true, false, true, false]);
  });
});

describe("the head", () => {
  const RANGE = { minimum: -0.5, maximum: 1.2, home: 0 };

  test("is requested as the visitor wants, within its range and not too often", () => {
    const tilting = new Tilting();
    assert.equal(tilting.take(0), null);
    tilting.want(3, RANGE);
    assert.equal(tilting.take(0), 1.2);
    tilting.want(0.2, RANGE);
    assert.equal(tilting.take(0.05), null);
    tilting.want(0.4, RANGE);
    assert.equal(tilting.take(0.2), 0.4);
    tilting.want(0.4, RANGE);
    assert.equal(tilting.take(0.5), null);
  });

  test("shows the visitor's angle first, and then the reported one", () => {
    const tilting = new Tilting();
    assert.equal(tilting.shown(0.1, 0), 0.1);
    tilting.want(0.5, RANGE);
    assert.equal(tilting.shown(0.1, 0), 0.5);
    tilting.take(0);
    assert.equal(tilting.shown(0.1, 1), 0.5);
    assert.equal(tilting.shown(0.45, 3), 0.5);
    assert.equal(tilting.shown(0.45, 5), 0.45);
  });

  test("the slider stays at a hand that holds it, whatever the robot reports", () => {
    const tilting = new Tilting();
    tilting.want(0.5, RANGE);
    tilting.take(0);
    tilting.hold(0.1);
    assert.equal(tilting.shown(0.45, 0.1), 0.1);
    assert.equal(tilting.shown(0.45, 30), 0.1);
    tilting.want(0.3, RANGE);
    tilting.take(31);
    assert.equal(tilting.shown(0.45, 60), 0.3);
    tilting.letGo();
    assert.equal(tilting.shown(0.45, 60), 0.45);
  });

  test("keeps the requested angle until the head has reached it", () => {
    const tilting = new Tilting();
    tilting.want(0.3, RANGE);
    tilting.take(0);
    assert.equal(tilting.shown(0.31, 0.1), 0.3);
    assert.equal(tilting.shown(0.31, 1), 0.31);
    assert.equal(tilting.shown(0.1, 3), 0.3);
  });
});

describe("the robot's own display", () => {
  const told = (changes = {}) => ({
    keyed: true,
    online: true,
    heardAt: 100,
    stop: null,
    screen: { title: "Giraff", session: "s1", visitor: "Ana", study: false },
    state: { safety: { estop: false, estopSource: null }, call: null },
    ...changes,
  });
  const calling = (call, more = {}) =>
    told({ state: { safety: { estop: false }, call: { ...accepted, ...call } }, ...more });
  const scene = (from, now = 100) => sceneFor(from, now).scene;

  test("shows the robot's title in the display's language", () => {
    const screen = { title: "Giraff", titles: { es: "Jirafa" }, session: null, visitor: null };
    assert.deepEqual(
      ["en", "es", "es-MX", "ES"].map((language) => titleOf({ ...screen, study: false }, language)),
      ["Giraff", "Jirafa", "Jirafa", "Jirafa"],
    );
    assert.equal(titleOf(null, "es"), "");
  });

  test("shows problems, and the visitor", () => {
    assert.equal(scene(told({ keyed: false })), "no_key");
    assert.equal(scene(told({ screen: null })), "starting");
    assert.equal(scene(told({ online: false })), "offline");
    assert.equal(scene(told(), 105), "offline");
    const nobody = { title: "Giraff", session: null, visitor: null, study: false };
    assert.equal(
      scene(told({ screen: nobody }), 135),
      "idle",
      "nobody drives, so the robot may be silent",
    );
    assert.equal(scene(told({ screen: nobody }), 150), "offline");
    assert.equal(
      scene(told({ screen: { title: "Giraff", session: null, visitor: null, study: false } })),
      "idle",
    );
    assert.equal(scene(told()), "visiting");
  });

  test("rings until it is answered, and shows only accepted video", () => {
    assert.equal(scene(calling({ status: "ringing" })), "ringing");
    assert.equal(scene(calling({ status: "unanswered" })), "ringing");
    assert.equal(scene(calling({ status: "declined" })), "visiting");
    assert.equal(scene(calling({})), "seen");
    assert.equal(scene(calling({ video: false })), "speaking");
    assert.equal(sceneFor(calling({ status: "ringing" }), 100).sound, 0);
    assert.equal(sceneFor(calling({ volume: 0.4 }), 100).sound, 0.4);
  });

  test("shows a whole screen, and takes pointers while it is shown", () => {
    const points = (call, now = 100) => sceneFor(calling(call), now).canPoint;
    assert.deepEqual(
      [
        points({ shares: true }),
        points({ shares: false }),
        points({ shares: true, status: "ringing" }),
      ],
      [true, false, false],
    );
    assert.deepEqual(
      [points({ shares: true, video: false }), points({ shares: true }, 105)],
      [false, false],
    );
    assert.equal(sceneFor(calling({ shares: true }), 100).whole, true);
    assert.equal(sceneFor(calling({}), 100).whole, false);
    assert.equal(sceneFor(told(), 100).canPoint, false);
  });

  test("mentions a study only during its session", () => {
    assert.equal(
      sceneFor(told({ screen: { title: "G", session: "s", visitor: "Ana", study: true } }), 100)
        .study,
      true,
    );
    assert.equal(
      sceneFor(told({ screen: { title: "G", session: null, visitor: null, study: true } }), 100)
        .study,
      false,
    );
  });

  test("shows who stopped the robot, and an unconfirmed stop", () => {
    const latched = (estopSource) =>
      told({ state: { safety: { estop: true, estopSource }, call: null } });
    assert.equal(sceneFor(latched("screen:Giraff"), 100).stopped, "ours");
    assert.equal(sceneFor(latched("staff:Berta"), 100).stopped, "other");
    assert.equal(sceneFor(told({ stop: { id: "x", since: 99.5 } }), 100).stopped, "wait");
    assert.equal(sceneFor(told({ stop: { id: "x", since: 95 } }), 100).stopped, "unconfirmed");
  });

  test("speaks where the browser can, in the message's language", () => {
    const spoken = [];
    const voice = createVoice({
      synthesis: { speak: (one) => spoken.push(one), cancel: () => undefined },
      Utterance: class {
        constructor(text) {
          this.text = text;
        }
      },
    });
    assert.equal(voice.speak("Hola", "es", 0.5), true);
    assert.deepEqual([spoken[0].text, spoken[0].lang, spoken[0].volume], ["Hola", "es", 0.5]);
    assert.equal(voice.speak("Hola", "es", 0), false);
    assert.equal(
      createVoice({ synthesis: undefined, Utterance: undefined }).speak("Hola", "es", 1),
      false,
    );
  });
});
