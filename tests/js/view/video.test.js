import assert from "node:assert/strict";
import { test } from "node:test";

import { between, pick } from "../../../static/js/protocol/link_stats.js";
import { ShownFrame, captureStamp } from "../../../static/js/view/video/capture_stamp.js";

const CLOCK = { rtp: 4294967000, stamp: 1000, rate: 90000 };

test("a frame after the time of media is later, one before it earlier", () => {
  assert.equal(captureStamp(4294967000 + 180, CLOCK), 1000.002);
  assert.equal(captureStamp(4294967000 - 90000, CLOCK), 999);
});

test("the counter wraps unnoticed", () => {
  assert.ok(Math.abs(captureStamp(90000 - 296, CLOCK) - 1001) < 1e-9);
  assert.ok(Math.abs(captureStamp(4294967295, { ...CLOCK, rtp: 5 }) - (1000 - 6 / 90000)) < 1e-9);
});

test("a frame far from the time of media belongs to another stream", () => {
  assert.equal(captureStamp(2 ** 31, CLOCK), null);
});

test("the shown frame has a stamp with both frame and clock, not after a new stream", () => {
  const shown = new ShownFrame();
  shown.shown(4294967000);
  assert.equal(shown.stamp, null);
  shown.clock = CLOCK;
  assert.equal(shown.stamp, 1000);
  shown.reset();
  assert.equal(shown.stamp, null);
});

const report = (more) => [
  {
    id: "v",
    type: "inbound-rtp",
    kind: "video",
    timestamp: 1000,
    framesDecoded: 10,
    packetsReceived: 100,
    packetsLost: 0,
    bytesReceived: 1000,
    freezeCount: 0,
    jitter: 0.004,
    ...more,
  },
  { id: "t", type: "transport", selectedCandidatePairId: "p" },
  { id: "p", type: "candidate-pair", localCandidateId: "l" },
  {
    id: "l",
    type: "local-candidate",
    candidateType: "relay",
    protocol: "udp",
    relayProtocol: "tcp",
  },
];

test("a second of the connection is the difference of two reports", () => {
  const second = between(
    pick(report()),
    pick(
      report({
        timestamp: 2000,
        framesDecoded: 40,
        packetsReceived: 190,
        packetsLost: 10,
        bytesReceived: 126000,
        freezeCount: 1,
      }),
    ),
  );
  assert.deepEqual(second, {
    fps: 30,
    loss: 0.1,
    bitrate: 1e6,
    freezes: 1,
    jitter: 0.004,
    path: "relay/tcp",
  });
});

test("restarted counters, a negative loss and simultaneous reports give no nonsense", () => {
  const second = between(
    pick(report({ packetsLost: 5 })),
    pick(
      report({
        timestamp: 2000,
        framesDecoded: 0,
        packetsReceived: 0,
        packetsLost: -3,
        bytesReceived: 0,
      }),
    ),
  );
  assert.deepEqual([second.fps, second.loss, second.bitrate], [0, 0, 0]);
  assert.equal(between(pick(report()), pick(report())), null);
});

test("a browser without a named transport has its pair found; without video no sample", () => {
  const firefox = [
    report()[0],
    { id: "p", type: "candidate-pair", nominated: true, state: "succeeded", localCandidateId: "l" },
    { id: "l", candidateType: "host", protocol: "udp" },
  ];
  assert.equal(pick(firefox).path, "host/udp");
  assert.equal(pick([]), null);
});
