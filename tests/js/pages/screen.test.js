import assert from "node:assert/strict";
import test from "node:test";

import { Giving } from "../../../static/js/pages/screen/media_sender.js";

/** A peer whose robot wants what is named, and what each of its lines was given. */
const peerThatWants = (...kinds) => {
  const given = {};
  const line = (kind, yes, no) => ({
    currentDirection: kinds.includes(kind) ? yes : no,
    sender: { replaceTrack: async (track) => void (given[kind] = track) },
  });
  return {
    lines: [
      line("audio", "sendrecv", "recvonly"),
      { currentDirection: "recvonly" },
      line("video", "sendonly", "inactive"),
    ],
    isClosed: false,
    given,
  };
};

const world = (...troubles) => {
  const closed = [];
  const again = [];
  const devices = {
    tracks: { audio: null, video: null },
    open: async (kind) => {
      const trouble = troubles.shift() ?? null;
      devices.tracks[kind] = trouble ? null : `${kind} track`;
      return trouble;
    },
    close: (kind) => closed.push(kind),
  };
  let changes = 0;
  const giving = new Giving({
    devices,
    onChange: () => (changes += 1),
    later: (call, seconds) => again.push([call, seconds]),
  });
  return { giving, closed, again, changes: () => changes };
};

test("a robot with eyes of its own is given nothing, and no device is asked for", async () => {
  const { giving, closed, changes } = world("would fail");
  const peer = peerThatWants();
  await giving.to(peer);
  assert.deepEqual(
    [peer.given, closed, giving.trouble, changes()],
    [{}, ["audio", "video"], "", 0],
  );
});

test("a robot that wants both is given both", async () => {
  const { giving } = world();
  const peer = peerThatWants("audio", "video");
  await giving.to(peer);
  assert.deepEqual(peer.given, { audio: "audio track", video: "video track" });
});

test("what a browser refuses is said, and tried again until it gives", async () => {
  const { giving, again } = world("refused");
  const peer = peerThatWants("video");
  await giving.to(peer);
  assert.equal(giving.trouble, "refused");
  assert.equal(again[0][1], 5);
  again[0][0]();
  await new Promise(setImmediate);
  assert.deepEqual([giving.trouble, peer.given], ["", { video: "video track" }]);
});

test("an unplugged camera is asked for again, for the current connection only", async () => {
  const { giving, again } = world(null, "missing");
  const old = peerThatWants("video");
  await giving.to(old);
  giving.lost("video");
  await new Promise(setImmediate);
  assert.equal(giving.trouble, "missing");
  const peer = peerThatWants("video");
  await giving.to(peer);
  old.given = {};
  again[0][0]();
  await new Promise(setImmediate);
  assert.deepEqual([old.given, peer.given, giving.trouble], [{}, { video: "video track" }, ""]);
});
