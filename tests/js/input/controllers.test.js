import assert from "node:assert/strict";
import { describe, test } from "node:test";

import { Arbiter } from "../../../static/js/input/arbiter.js";
import { onFocusLoss } from "../../../static/js/input/focus_loss.js";
import { Keyboard, direction } from "../../../static/js/input/keyboard.js";
import { KeyDispatcher } from "../../../static/js/input/key_dispatcher.js";
import { START, STEPS, fullSpeeds, ramp, toVelocity } from "../../../static/js/input/speeds.js";
import { sharesOf } from "../../../static/js/input/stick.js";

const AHEAD = { linear: 0.4, angular: 0 };
const LEFT = { linear: 0, angular: 0.5 };
const STILL = { linear: 0, angular: 0 };

describe("arbiter", () => {
  const rig = () => {
    const emitted = [];
    return {
      arbiter: new Arbiter((intent) =>
        emitted.push(`${intent.method} ${intent.linear} ${intent.angular}`),
      ),
      emitted,
    };
  };

  test("the last controller that was used steers", () => {
    const { arbiter, emitted } = rig();
    arbiter.offer("keyboard", AHEAD);
    arbiter.offer("stick", LEFT);
    arbiter.offer("keyboard", { linear: 0.5, angular: 0 });
    assert.deepEqual(emitted, ["keyboard 0.4 0", "stick 0 0.5"]);
  });

  test("an older controller that is still held must be pressed again", () => {
    const { arbiter, emitted } = rig();
    arbiter.offer("keyboard", AHEAD);
    arbiter.offer("stick", LEFT);
    arbiter.offer("stick", STILL);
    arbiter.offer("keyboard", AHEAD);
    assert.equal(emitted.at(-1), "stick 0 0");
    arbiter.offer("keyboard", STILL);
    arbiter.offer("keyboard", AHEAD);
    assert.equal(emitted.at(-1), "keyboard 0.4 0");
  });

  test("releasing a controller that does not steer has no effect", () => {
    const { arbiter, emitted } = rig();
    arbiter.offer("keyboard", AHEAD);
    arbiter.offer("stick", STILL);
    assert.equal(emitted.at(-1), "keyboard 0.4 0");
  });

  test("a release stops the robot, whichever controller steered", () => {
    const { arbiter, emitted } = rig();
    arbiter.offer("stick", LEFT);
    arbiter.release();
    assert.equal(emitted.at(-1), "stick 0 0");
  });
});

describe("ramp", () => {
  test("a key starts at a low speed and reaches full speed within a second", () => {
    assert.equal(ramp(0, 1, 0), START);
    assert.ok(ramp(START, 1, 0.1) > START);
    let share = 0;
    for (let t = 0; t < 0.8; t += 0.016) {
      share = ramp(share, 1, 0.016);
    }
    assert.equal(share, 1);
  });

  test("a release and a reversal take effect at once", () => {
    assert.equal(ramp(0.9, 0, 0.016), 0);
    assert.equal(ramp(0.9, -1, 0.016), -START);
  });

  test("a share never exceeds full speed after a long frame", () => {
    assert.equal(ramp(0.9, 1, 60), 1);
    assert.equal(ramp(-0.9, -1, 60), -1);
  });
});

describe("speeds", () => {
  const robot = { linear: 0.7, reverse: 0.3, angular: 0.7 };
  const free = { linear: null, angular: null };

  test("the last step is the robot's limit", () => {
    assert.deepEqual(fullSpeeds(robot, free, STEPS.length - 1), robot);
  });

  test("a lease can only lower it", () => {
    assert.deepEqual(fullSpeeds(robot, { linear: 0.2, angular: 5 }, 2), {
      linear: 0.2,
      reverse: 0.2,
      angular: 0.7,
    });
  });

  test("an unknown robot is driven cautiously", () => {
    assert.ok(fullSpeeds(null, free, 2).linear <= 0.4);
  });

  test("backwards uses the reverse limit, and zero is never negative", () => {
    assert.deepEqual(toVelocity({ ahead: -1, left: 1 }, robot), { linear: -0.3, angular: 0.7 });
    assert.ok(Object.is(toVelocity({ ahead: -0, left: -0 }, robot).linear, 0));
  });
});

describe("stick", () => {
  test("is zero in its middle and full at its rim and beyond", () => {
    assert.deepEqual(sharesOf(0.1, 0.05), { ahead: 0, left: 0 });
    assert.deepEqual(sharesOf(0, -1), { ahead: 1, left: 0 });
    assert.deepEqual(sharesOf(0, 3), { ahead: -1, left: 0 });
    assert.deepEqual(sharesOf(1, 0), { ahead: 0, left: -1 });
  });

  test("nearly straight is straight", () => {
    assert.equal(sharesOf(0.05, -0.9).left, 0);
  });

  test("a small deflection is a low speed", () => {
    const { ahead } = sharesOf(0, -0.3);
    assert.ok(ahead > 0.1 && ahead < 0.25);
  });
});

describe("keyboard", () => {
  const rig = () => {
    const target = new EventTarget();
    const log = [];
    const frames = [];
    let now = 0;
    const keyboard = new Keyboard({
      keys: new KeyDispatcher({
        target,
        root: { querySelectorAll: () => [] },
        watch: () => undefined,
      }),
      emit: ({ ahead, left }) => log.push([ahead, left]),
      stop: () => log.push("stop"),
      step: (change) => log.push(`step ${change}`),
      frame: (callback) => frames.push(callback),
      now: () => now,
    });
    const press = (type, code, more = {}) => {
      const event = Object.assign(new Event(type, { cancelable: true }), { code, ...more });
      if (more.on) {
        Object.defineProperty(event, "target", { value: more.on });
      }
      target.dispatchEvent(event);
      return event;
    };
    const pass = (ms) => {
      now += ms;
      frames.splice(0).forEach((callback) => callback(now));
    };
    keyboard.enable();
    return { keyboard, log, press, pass };
  };
  const button = { closest: (selector) => (selector.includes("button") ? {} : null) };

  test("a pressed key drives at once, faster while held, until its release", () => {
    const { log, press, pass } = rig();
    press("keydown", "ArrowUp");
    pass(50);
    press("keyup", "ArrowUp");
    assert.deepEqual(log[0], [START, 0]);
    assert.ok(log[1][0] > START);
    assert.deepEqual(log.at(-1), [0, 0]);
  });

  test("W A S D work like the arrow keys, and opposite keys cancel out", () => {
    assert.deepEqual(direction(["forward", "left"]), { ahead: 1, left: 1 });
    assert.deepEqual(direction(["forward", "backward"]), { ahead: 0, left: 0 });
    assert.deepEqual(direction(["forward", "forward", "right"]), { ahead: 1, left: -1 });
  });

  test("a key with a modifier belongs to the browser and releases all others", () => {
    const { log, press } = rig();
    press("keydown", "ArrowUp");
    const event = press("keydown", "KeyS", { ctrlKey: true });
    assert.equal(event.defaultPrevented, false);
    assert.deepEqual(log.at(-1), [0, 0]);
  });

  test("the browser's repetition does not press a released key", () => {
    const { keyboard, log, press } = rig();
    press("keydown", "ArrowUp");
    keyboard.letGo();
    press("keydown", "ArrowUp", { repeat: true });
    assert.deepEqual(log, [
      [START, 0],
      [0, 0],
    ]);
  });

  test("the space bar stops, and also presses a focused button", () => {
    const { log, press } = rig();
    assert.equal(press("keydown", "Space").defaultPrevented, true);
    assert.equal(press("keydown", "Space", { on: button }).defaultPrevented, false);
    assert.deepEqual(log, ["stop", "stop"]);
  });

  test("disabling releases the keys and stops the robot", () => {
    const { keyboard, log, press } = rig();
    press("keydown", "ArrowUp");
    keyboard.disable();
    press("keydown", "ArrowUp");
    assert.deepEqual(log.slice(1), [[0, 0], "stop"]);
  });

  test("a page after a long frame does not jump to full speed", () => {
    const { log, press, pass } = rig();
    press("keydown", "ArrowUp");
    pass(5000);
    assert.ok(log.at(-1)[0] < 0.5);
  });

  test("plus and minus change the speed", () => {
    const { log, press } = rig();
    press("keydown", "Equal");
    press("keydown", "Minus");
    assert.deepEqual(log, ["step 1", "step -1"]);
  });
});

describe("guard", () => {
  test("losing focus, hiding the tab and leaving the page release all controllers", () => {
    const window = new EventTarget();
    const document = Object.assign(new EventTarget(), { visibilityState: "visible" });
    const why = [];
    onFocusLoss((reason) => why.push(reason), { window, document });
    window.dispatchEvent(new Event("blur"));
    document.dispatchEvent(new Event("visibilitychange"));
    document.visibilityState = "hidden";
    document.dispatchEvent(new Event("visibilitychange"));
    window.dispatchEvent(new Event("pagehide"));
    assert.deepEqual(why, ["blur", "hidden", "pagehide"]);
  });
});
