import assert from "node:assert/strict";
import { describe, test } from "node:test";

import { ask } from "../../../static/js/protocol/robot_action.js";
import { createKnock, lineOfKnock } from "../../../static/js/presence/knock.js";
import { createChime } from "../../../static/js/pages/screen/chime.js";
import { sceneFor } from "../../../static/js/pages/screen/scene.js";

describe("the note about a knock", () => {
  const asked = (changes = {}) => ({ ...ask({ type: "knock" }, "k1", 100), ...changes });
  const known = (status, actionId = "k1") => ({ actionId, status });

  test("shows the answers of the robot and of the people there", () => {
    const done = asked({ status: "FINISHED" });
    assert.deepEqual(lineOfKnock(null, known("ringing")), { word: "", ended: true });
    assert.equal(lineOfKnock(asked(), null).word, "knock.asked");
    assert.equal(lineOfKnock(done, known("answered", "k0")).word, "knock.asked");
    for (const status of ["ringing", "answered", "declined", "unanswered"]) {
      assert.deepEqual(lineOfKnock(done, known(status)), {
        word: `knock.${status}`,
        ended: status !== "ringing",
      });
    }
  });

  test("shows why the knock has no effect", () => {
    const failed = (reason) => lineOfKnock(asked({ status: "FAILED", reason }), null).word;
    assert.deepEqual(
      ["too_soon", "declined", "nobody_there", "no_answer", "not_allowed"].map(failed),
      ["knock.too_soon", "knock.declined", "knock.nobody_there", "knock.failed", "knock.failed"],
    );
  });
});

describe("knocking", () => {
  const world = () => {
    const elements = {};
    const element = (id) => (elements[id] ??= { hidden: true, textContent: "" });
    const sent = [];
    const state = { robot: { knock: null } };
    const page = {
      store: { get: () => state },
      driving: { sendAction: (action) => sent.push(action.id) },
      element,
      words: { say: (key) => key },
    };
    const said = () => (element("knock-note").hidden ? "" : element("knock-note-text").textContent);
    return { knock: createKnock(page), sent, state, said };
  };

  test("is repeated until the robot answers, and its note disappears", () => {
    const { knock, sent, state, said } = world();
    knock.knock();
    const now = Date.now() / 1000;
    knock.poll(now + 1);
    assert.equal(sent.length, 2);
    assert.equal(new Set(sent).size, 1);
    knock.answered({
      actionId: sent[0],
      status: "FINISHED",
      type: "knock",
      reason: "",
      result: {},
    });
    state.robot.knock = { actionId: sent[0], status: "ringing" };
    knock.poll(now + 2);
    knock.poll(now + 25);
    assert.equal(said(), "knock.ringing");
    state.robot.knock = { actionId: sent[0], status: "answered" };
    knock.poll(now + 26);
    assert.equal(said(), "knock.answered");
    knock.poll(now + 40);
    assert.equal(said(), "");
    assert.equal(sent.length, 2);
  });

  test("fails without an answer, and can be repeated", () => {
    const { knock, sent, said } = world();
    knock.knock();
    const now = Date.now() / 1000;
    knock.poll(now + 4);
    assert.equal(said(), "knock.failed");
    knock.knock();
    assert.equal(said(), "knock.asked");
    assert.equal(new Set(sent).size, 2);
  });

  test("without an end does not stay for ever", () => {
    const { knock, sent, said } = world();
    knock.knock();
    const now = Date.now() / 1000;
    knock.answered({
      actionId: sent[0],
      status: "FINISHED",
      type: "knock",
      reason: "",
      result: {},
    });
    knock.poll(now + 1);
    assert.equal(said(), "knock.asked");
    knock.poll(now + 10);
    assert.equal(said(), "");
  });
});

describe("on the robot's own display", () => {
  const told = (knock, more = {}) => ({
    keyed: true,
    online: true,
    heardAt: 100,
    stop: null,
    screen: { title: "Giraff", session: "s1", visitor: "Ana", study: false },
    state: { safety: { estop: false }, call: null, knock },
    ...more,
  });
  const ringing = { actionId: "k1", status: "ringing" };

  test("a knock rings during a session, until it is answered", () => {
    assert.equal(sceneFor(told(ringing), 100).knock, "k1");
    assert.equal(sceneFor(told({ ...ringing, status: "answered" }), 100).knock, "");
    assert.equal(sceneFor(told(null), 100).knock, "");
    assert.equal(sceneFor(told(ringing), 200).knock, "", "the robot is out of reach");
    const left = { title: "Giraff", session: null, visitor: null, study: false };
    assert.equal(sceneFor(told(ringing, { screen: left }), 100).knock, "");
  });

  const contextIn = (state) => {
    const played = [];
    const parameter = () => ({
      setValueAtTime: () => undefined,
      linearRampToValueAtTime: (level) => played.at(-1).push(level),
      setTargetAtTime: () => undefined,
    });
    const node = (more) => ({ connect: (to) => to, ...more });
    return {
      played,
      context: {
        state,
        currentTime: 1,
        destination: {},
        resume: async () => undefined,
        createOscillator: () => {
          const frequency = {};
          return node({
            frequency,
            start: () => played.push([frequency.value]),
            stop: () => undefined,
          });
        },
        createGain: () => {
          const gain = parameter();
          const levels = [];
          gain.linearRampToValueAtTime = (level) => levels.push(level);
          return node({ gain, levels });
        },
      },
    };
  };

  test("two notes sound, unless the browser or the volume silences them", async () => {
    const running = contextIn("running");
    const chime = createChime(() => running.context);
    assert.equal(await chime.ring(0.5), true);
    assert.deepEqual(running.played.flat(), [659.25, 1318.5, 523.25, 1046.5]);
    assert.equal(await chime.ring(0), false);
    assert.equal(await chime.ring(1), true);
    assert.equal(running.played.length, 8);
    const refused = contextIn("suspended");
    assert.equal(await createChime(() => refused.context).ring(1), false);
    assert.deepEqual(refused.played, []);
  });
});
