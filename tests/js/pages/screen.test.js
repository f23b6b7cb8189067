import assert from "node:assert/strict";
import test from "node:test";

import { MediaSender } from "../../../static/js/pages/screen/media_sender.js";

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
  const mediaSender = new MediaSender({
    devices,
    onChange: () => (changes += 1),
    later: (call, seconds) => again.push([call, seconds]),
  });
  return { mediaSender, closed, again, changes: () => changes };
};

test("a robot with its own camera and microphone gets none", async () => {
  const { mediaSender, closed, changes } = world("would fail");
  const peer = peerThatWants();
  await mediaSender.to(peer);
  assert.deepEqual(
    [peer.given, closed, mediaSender.trouble, changes()],
    [{}, ["audio", "video"], "", 0],
  );
});

test("a robot that wants both gets both", async () => {
  const { mediaSender } = world();
  const peer = peerThatWants("audio", "video");
  await mediaSender.to(peer);
  assert.deepEqual(peer.given, { audio: "audio track", video: "video track" });
});

test("a refusal of the browser is shown, and the device is requested again", async () => {
  const { mediaSender, again } = world("refused");
  const peer = peerThatWants("video");
  await mediaSender.to(peer);
  assert.equal(mediaSender.trouble, "refused");
  assert.equal(again[0][1], 5);
  again[0][0]();
  await new Promise(setImmediate);
  assert.deepEqual([mediaSender.trouble, peer.given], ["", { video: "video track" }]);
});

test("an unplugged camera is requested again, for the current connection only", async () => {
  const { mediaSender, again } = world(null, "missing");
  const old = peerThatWants("video");
  await mediaSender.to(old);
  mediaSender.lost("video");
  await new Promise(setImmediate);
  assert.equal(mediaSender.trouble, "missing");
  const peer = peerThatWants("video");
  await mediaSender.to(peer);
  old.given = {};
  again[0][0]();
  await new Promise(setImmediate);
  assert.deepEqual(
    [old.given, peer.given, mediaSender.trouble],
    [{}, { video: "video track" }, ""],
  );
});
