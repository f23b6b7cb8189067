/** The keys of the drive page: static/js/input/keymap.js. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { describe, test } from "node:test";

import { DEFAULTS, Keymap, MAP_DEFAULTS, labelOf } from "../../../static/js/input/keymap.js";

const read = (name) => readFileSync(new URL(`../../../${name}`, import.meta.url), "utf8");

describe("the keymap", () => {
  test("has each key once, on the page and on the map", () => {
    for (const keys of [DEFAULTS, MAP_DEFAULTS]) {
      const all = Object.values(keys).flat();
      assert.equal(new Set(all).size, all.length);
    }
  });

  test("knows a key by its place, or by its character", () => {
    const keymap = new Keymap();
    assert.equal(keymap.commandOf({ code: "KeyW" }), "forward");
    assert.equal(keymap.commandOf({ code: "KeyQ", key: "q" }), "");
    assert.equal(keymap.mapCommandOf({ code: "BracketRight", key: "+" }), "map_in");
    assert.equal(keymap.mapCommandOf({ code: "ArrowUp", key: "ArrowUp" }), "map_up");
  });

  test("takes a visitor's own keys from other commands", () => {
    const keymap = new Keymap({ talk: ["KeyF"], unknown: ["KeyW"] });
    const commands = ["KeyF", "KeyT", "KeyW"].map((code) => keymap.commandOf({ code }));
    assert.deepEqual(commands, ["talk", "", "forward"]);
    const { key_talk, key_look_down, key_forward } = keymap.labels();
    assert.deepEqual([key_talk, key_look_down, key_forward], ["F", "–", "↑"]);
  });

  test("gives a command one key, which no other command has", () => {
    const keymap = new Keymap();
    keymap.use(keymap.withKey("talk", "KeyW"));
    keymap.use(keymap.withKey("forward", "KeyI"));
    assert.deepEqual(
      ["KeyW", "KeyI", "ArrowUp", "KeyT", "KeyS"].map((code) => keymap.commandOf({ code })),
      ["talk", "forward", "", "", "backward"],
    );
    keymap.use(keymap.withKey("look_up", "KeyI"));
    assert.deepEqual(keymap.keys.forward, []);
    keymap.use({});
    assert.deepEqual(keymap.keys, new Keymap().keys);
  });

  test("always has a key that stops the robot", () => {
    const keymap = new Keymap();
    assert.equal(keymap.refuses("talk", "Space"), "stop");
    assert.equal(keymap.refuses("stop", "Space"), "");
    keymap.use(keymap.withKey("stop", "KeyX"));
    assert.deepEqual(
      [keymap.refuses("talk", "Space"), keymap.refuses("talk", "KeyX")],
      ["", "stop"],
    );
    for (const spoiled of [{ stop: [] }, { talk: ["Space"] }, { stop: [], talk: ["Space"] }]) {
      assert.equal(new Keymap(spoiled).commandOf({ code: "Space" }), "stop");
    }
  });

  test("refuses keys that the browser and the page need", () => {
    const keymap = new Keymap();
    for (const key of [
      "",
      "Escape",
      "Tab",
      "Enter",
      "F5",
      "ShiftLeft",
      "MetaRight",
      "MediaPlayPause",
    ]) {
      assert.equal(keymap.refuses("talk", key), "never", key);
    }
    assert.equal(keymap.refuses("talk", "KeyF"), "");
  });

  test("labels a key as it is printed", () => {
    const labels = ["ArrowLeft", "KeyT", "Digit4", "Numpad7", "Minus"].map(labelOf);
    assert.deepEqual(labels, ["←", "T", "4", "7", "−"]);
  });

  test("writes the hints and sentences of the page", () => {
    const names = ["drive", "_presence", "_presence_words"];
    const pages = names.map((name) => read(`templates/sessions/${name}.html`)).join("\n");
    const commands = [...pages.matchAll(/data-keys="([^"]+)"/g)].flatMap(([, list]) =>
      list.split(" "),
    );
    const named = [...pages.matchAll(/\{key_(\w+)\}/g)].map(([, command]) => command);
    assert.deepEqual(
      [...commands, ...named].filter((command) => !(command in DEFAULTS)),
      [],
    );
    assert.deepEqual(
      Object.keys(DEFAULTS).filter((command) => ![...commands, ...named].includes(command)),
      [],
    );
    assert.doesNotMatch(pages, /<kbd>/);
  });
});
