/** The one rule about the page's keys: static/js/input/key_dispatcher.js. */

import assert from "node:assert/strict";
import { readFileSync, readdirSync } from "node:fs";
import { describe, test } from "node:test";

import { Keyboard } from "../../../static/js/input/keyboard.js";
import { KeyDispatcher, keyUse } from "../../../static/js/input/key_dispatcher.js";
import { PushToTalk } from "../../../static/js/presence/push_to_talk.js";

/** An element of a tag with attributes that answers the rule's selectors as a browser would. */
const at = (tag, attributes = {}) => ({
  closest: (selectors) =>
    selectors.match(/[a-z]*(?:\[[^\]]*\]|:not\([^)]*\))*/g).some((one) => {
      const [, name, rest] = /^([a-z]*)(.*)$/.exec(one);
      const has = (part) => {
        const [, key, , value] = /^\[([a-z-]+)(='([^']*)')?\]$/.exec(part);
        return key in attributes && (value === undefined || attributes[key] === value);
      };
      const without = [...rest.matchAll(/:not\(([^)]*)\)/g)].flatMap(([, list]) =>
        list.split(", "),
      );
      const wanted = rest.replace(/:not\([^)]*\)/g, "").match(/\[[^\]]*\]/g) ?? [];
      return one !== "" && (name === "" || name === tag) && wanted.every(has) && !without.some(has);
    }) || null,
});

const BODY = at("body");
const FIELD = at("input", { type: "text" });
const rig = () => {
  const target = new EventTarget();
  const open = [];
  const log = [];
  let look;
  const root = { querySelectorAll: () => open, activeElement: BODY };
  const keys = new KeyDispatcher({ target, root, watch: (looks) => (look = looks) });
  const keyboard = new Keyboard({
    keys,
    emit: ({ ahead, left }) => log.push(ahead || left ? "drive" : "still"),
    stop: () => log.push("stop"),
    step: (change) => log.push(`step ${change}`),
    frame: () => undefined,
    now: () => 0,
  });
  keyboard.enable();
  const tilt = { down: () => log.push("tilt") };
  const talk = new PushToTalk((down) => log.push(down ? "talk" : "quiet"));
  keys.addCommands({ talk, look_up: tilt, look_down: tilt });
  const send = (type, code, { on = BODY, ...more } = {}) => {
    const event = Object.assign(new Event(type, { cancelable: true }), {
      code,
      key: code,
      ...more,
    });
    Object.defineProperty(event, "target", { value: on });
    target.dispatchEvent(event);
    return event;
  };
  const holder = {
    id: "menu",
    closest: () => (open.includes(holder) ? null : holder),
    contains: (one) => one === "inside",
  };
  const shows = (isOpen) => {
    open.splice(0, open.length, ...(isOpen ? [holder] : []));
    look();
  };
  return { keys, log, send, shows, holder, root };
};
const ALL = [
  "KeyW",
  "KeyA",
  "KeyS",
  "KeyD",
  "ArrowUp",
  "ArrowDown",
  "ArrowLeft",
  "ArrowRight",
  "KeyR",
  "KeyF",
  "KeyT",
  "Equal",
  "Minus",
  "Slash",
  "BracketRight",
  "NumpadAdd",
  "NumpadSubtract",
];

describe("the page's keys", () => {
  test("drive, tilt, talk and change the speed on the plain page", () => {
    for (const code of ALL) {
      const { log, send } = rig();
      send("keydown", code);
      assert.equal(log.length, 1, code);
    }
  });

  test("have no effect in fields, lists and editable text, not even space", () => {
    const fields = [
      FIELD,
      at("input"),
      at("input", { type: "search" }),
      at("textarea"),
      at("select"),
      at("div", { contenteditable: "true" }),
      at("div", { contenteditable: "" }),
    ];
    for (const on of fields) {
      const { log, send } = rig();
      [...ALL, "Space"].forEach((code) => send("keydown", code, { on }));
      assert.deepEqual(log, []);
    }
  });

  test("have no effect with Ctrl, Alt or Meta, or while composing a character", () => {
    for (const more of [
      { ctrlKey: true },
      { altKey: true },
      { metaKey: true },
      { isComposing: true },
      { keyCode: 229 },
    ]) {
      const { log, send } = rig();
      [...ALL, "Space"].forEach((code) => send("keydown", code, more));
      assert.deepEqual(log, []);
    }
  });

  test("have no effect on a slider, a box and the map; space stops unless it ticks", () => {
    for (const [on, stops] of [
      [at("input", { type: "range" }), 1],
      [at("canvas", { "data-own-keys": "" }), 1],
      [at("input", { type: "checkbox" }), 0],
    ]) {
      const { log, send } = rig();
      [...ALL, "Space"].forEach((code) => send("keydown", code, { on }));
      assert.deepEqual(log, Array(stops).fill("stop"));
    }
  });

  test("have no effect while a holder is open, except for the space bar", () => {
    const { log, send, shows } = rig();
    shows(true);
    ALL.forEach((code) => send("keydown", code));
    assert.deepEqual(log, []);
    send("keydown", "Space");
    assert.deepEqual(log, ["stop"]);
  });

  test("are released when a holder opens, until they are pressed again", () => {
    for (const [code, begins, ends] of [
      ["KeyW", "drive", "still"],
      ["KeyT", "talk", "quiet"],
    ]) {
      const { log, send, shows } = rig();
      send("keydown", code);
      shows(true);
      assert.deepEqual(log, [begins, ends]);
      shows(false);
      send("keydown", code, { repeat: true });
      assert.deepEqual(log, [begins, ends]);
      send("keyup", code);
      send("keydown", code);
      assert.deepEqual(log, [begins, ends, begins]);
    }
  });

  test("that were pressed in a field do not tilt when it has closed", () => {
    const { log, send } = rig();
    send("keydown", "KeyR", { on: FIELD });
    send("keydown", "KeyR", { repeat: true });
    assert.deepEqual(log, []);
    send("keyup", "KeyR");
    send("keydown", "KeyR");
    send("keydown", "KeyR", { repeat: true });
    assert.deepEqual(log, ["tilt", "tilt"]);
  });

  test("are released once when a field gets the focus or the window loses it", () => {
    for (const [type, more] of [
      ["focusin", { on: FIELD }],
      ["blur", {}],
    ]) {
      const { log, send } = rig();
      send("keydown", "KeyW");
      send(type, "", more);
      send("keyup", "KeyW", { on: FIELD });
      assert.deepEqual(log, ["drive", "still"]);
    }
  });

  test("a shortcut releases the other keys, whose release may be missed", () => {
    const { log, send } = rig();
    send("keydown", "KeyW");
    send("keydown", "KeyC", { metaKey: true });
    assert.deepEqual(log, ["drive", "still"]);
  });

  test("Escape closes only an open holder", () => {
    const { keys, log, send, shows, holder } = rig();
    const closed = [];
    keys.closes(
      holder,
      () => closed.push("escape"),
      () => closed.push("beside"),
    );
    send("keydown", "Escape");
    shows(true);
    send("keydown", "Escape", { on: FIELD, isComposing: true });
    assert.deepEqual(closed, []);
    send("keydown", "Escape", { on: FIELD });
    send("pointerdown", "", { on: "inside" });
    send("pointerdown", "", { on: { closest: () => null } });
    assert.deepEqual([closed, log], [["escape", "beside"], []]);
  });

  test("Escape closes an open panel that takes no keys, the last one first", () => {
    const { keys, send, holder, shows } = rig();
    const closed = [];
    const panel = (name) => ({ name, closest: () => null });
    const [photo, help] = [panel("photo"), panel("help")];
    for (const one of [photo, help]) {
      keys.closes(one, () => {
        closed.push(one.name);
        one.closest = () => one;
      });
    }
    keys.closes(holder, () => closed.push("holder"));
    shows(true);
    send("keydown", "Escape");
    shows(false);
    ["Escape", "Escape", "Escape"].forEach((key) => send("keydown", key));
    assert.deepEqual(closed, ["holder", "help", "photo"]);
  });

  test("know whether a holder or a field has them", () => {
    const { keys, shows, root } = rig();
    assert.equal(keys.taken, false);
    root.activeElement = FIELD;
    assert.equal(keys.taken, true);
    root.activeElement = BODY;
    shows(true);
    assert.equal(keys.taken, true);
  });

  test("of an event without a target are the page's", () => {
    assert.equal(keyUse({ code: "KeyW", target: null }, null), "free");
  });
});

test("all key listeners use the rule", () => {
  const root = new URL("../../../static/js/", import.meta.url);
  // a sign of presence, the choice of keys, which hand it was, and Escape of a menu of a light page
  const others = [
    "drive/activity.js",
    "input/own_keys.js",
    "view/overlay/floor_press.js",
    "pages/site.js",
  ];
  const heard = readdirSync(root, { recursive: true })
    .filter(
      (name) =>
        name.endsWith(".js") &&
        /["'](keydown|keyup|keypress)["']|\.onkey/.test(readFileSync(new URL(name, root), "utf8")),
    )
    .filter(
      (name) => !/from "[^"]*\/key_dispatcher\.js"/.test(readFileSync(new URL(name, root), "utf8")),
    );
  assert.deepEqual(heard.sort(), [...others, "input/key_dispatcher.js"].sort());
});
