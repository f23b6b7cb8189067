import assert from "node:assert/strict";
import { describe, test } from "node:test";

import { CommandStream, TICK_SECONDS } from "../../../static/js/protocol/command_stream.js";
import { TransportRouter } from "../../../static/js/protocol/transport_router.js";
import { ClockSync } from "../../../static/js/protocol/clock_sync.js";
import { decodePacket } from "../../../static/js/protocol/robot_api.js";

const LEASE = { session: "s1", epoch: 3 };
const AHEAD = { linear: 0.4, angular: 0, method: "keyboard" };
const STILL = { linear: 0, angular: 0, method: "keyboard" };

const stream = () => {
  let n = 0;
  const commands = new CommandStream({ freshId: () => `stop-${++n}` });
  commands.bind(LEASE);
  return commands;
};
const stateWith = (safety, epoch = 3) => ({
  epoch,
  safety: { estop: false, stopId: null, stopSeq: null, ...safety },
});

describe("velocities", () => {
  test("start, release and reversal are sent at once, others with the next tick", () => {
    const commands = stream();
    assert.equal(commands.intend(AHEAD), true);
    assert.equal(commands.intend({ ...AHEAD, linear: 0.5 }), false);
    assert.equal(commands.intend({ ...AHEAD, linear: -0.2 }), true);
    assert.equal(commands.intend(STILL), true);
    assert.equal(commands.intend(STILL), false);
  });

  test("a command has its lease, number, time and the frame that the visitor saw", () => {
    const commands = stream();
    commands.intend(AHEAD);
    assert.deepEqual(commands.velocity(12.5, 12.4), {
      ...LEASE,
      seq: 1,
      stamp: 12.5,
      linear: 0.4,
      angular: 0,
      method: "keyboard",
      frame: 12.4,
    });
    assert.equal(commands.velocity(12.55, null).frame, undefined);
  });

  test("a release sends three zeros, then nothing", () => {
    const commands = stream();
    commands.intend(AHEAD);
    commands.velocity(0, null);
    commands.intend(STILL);
    const after = Array.from({ length: 6 }, (_, i) => commands.velocity(i * TICK_SECONDS, null));
    assert.deepEqual(
      after.map((command) => command?.linear ?? null),
      [0, 0, 0, null, null, null],
    );
  });

  test("nothing is sent while idle", () => {
    assert.equal(stream().velocity(0, null), null);
  });

  test("numbers grow by one, and continue when the same lease is bound again", () => {
    const commands = stream();
    commands.intend(AHEAD);
    const first = [commands.velocity(0, null).seq, commands.velocity(0, null).seq];
    commands.bind({ ...LEASE });
    assert.deepEqual([...first, commands.velocity(0, null).seq], [1, 2, 3]);
  });

  test("a new epoch starts at rest and at 1", () => {
    const commands = stream();
    commands.intend(AHEAD);
    commands.velocity(0, null);
    commands.bind({ session: "s1", epoch: 4 });
    assert.equal(commands.velocity(0, null), null);
    commands.intend(AHEAD);
    assert.equal(commands.velocity(0, null).seq, 1);
  });

  test("without a lease nothing is sent", () => {
    const commands = stream();
    commands.unbind();
    assert.equal(commands.intend(AHEAD), false);
    assert.equal(commands.velocity(0, null), null);
  });
});

describe("stop", () => {
  test("a stop takes its number from the velocities' counter", () => {
    const commands = stream();
    commands.intend(AHEAD);
    commands.velocity(0, null);
    assert.deepEqual(commands.stop(1), {
      type: "stop",
      actionId: "stop-1",
      ...LEASE,
      seq: 2,
      stamp: 1,
    });
  });

  test("until the robot echoes it, it is repeated and nothing else is sent", () => {
    const commands = stream();
    commands.intend(AHEAD);
    commands.stop(1);
    assert.equal(commands.intend(AHEAD), false);
    assert.equal(commands.velocity(1.05, null), null);
    assert.deepEqual(
      [commands.repeat(1.05).actionId, commands.repeat(1.1).seq, commands.repeat(1.1).stamp],
      ["stop-1", 1, 1.1],
    );
    commands.heardState(stateWith({ stopId: "another", stopSeq: 0 }));
    assert.notEqual(commands.repeat(1.15), null);
    commands.heardState(stateWith({ stopId: "stop-1" }));
    assert.equal(commands.repeat(1.2), null);
  });

  test("after the echo the robot waits for a new input", () => {
    const commands = stream();
    commands.intend(AHEAD);
    commands.stop(1);
    commands.heardState(stateWith({ stopId: "stop-1" }));
    assert.equal(commands.velocity(1.3, null), null);
    assert.equal(commands.intend(AHEAD), true);
    assert.equal(commands.velocity(1.4, null).seq, 2);
  });

  test("its number echoes it under the same epoch only", () => {
    const commands = stream();
    commands.stop(1);
    commands.heardState(stateWith({ stopSeq: 1 }, 2));
    assert.notEqual(commands.pending, null);
    commands.heardState(stateWith({ stopSeq: 1 }));
    assert.equal(commands.pending, null);
  });

  test("the finished action is an echo; a failed one is not", () => {
    const commands = stream();
    commands.stop(1);
    commands.heardAction({ actionId: "stop-1", status: "FAILED" });
    assert.notEqual(commands.pending, null);
    commands.heardAction({ actionId: "stop-1", status: "FINISHED" });
    assert.equal(commands.pending, null);
  });

  test("pressing again before the echo is the same stop", () => {
    const commands = stream();
    commands.stop(1);
    assert.equal(commands.stop(1.2).actionId, "stop-1");
  });

  test("an e-stop outranks a stop and is echoed by the latch", () => {
    const commands = stream();
    commands.stop(1);
    assert.equal(commands.stop(1.1, "estop").type, "estop");
    commands.heardState(stateWith({ stopId: "stop-1" }));
    assert.notEqual(commands.pending, null);
    commands.heardState(stateWith({ estop: true }));
    assert.equal(commands.pending, null);
  });

  test("a stop needs no lease", () => {
    const commands = new CommandStream({ freshId: () => "x" });
    assert.deepEqual(commands.stop(1), { type: "stop", actionId: "x", seq: 1, stamp: 1 });
  });

  test("a stop is shown as unconfirmed after a second, and repeated slower after ten", () => {
    const commands = stream();
    commands.stop(1);
    assert.equal(commands.isUnconfirmed(1.9), false);
    assert.equal(commands.isUnconfirmed(2.1), true);
    assert.notEqual(commands.repeat(11), null);
    assert.equal(commands.repeat(11.05), null);
    assert.notEqual(commands.repeat(12.1), null);
  });

  test("a stop by the page itself is not shown as unconfirmed until it is pressed", () => {
    const commands = stream();
    commands.stop(1, "stop", false);
    assert.equal(commands.isUnconfirmed(60), false);
    assert.notEqual(commands.repeat(60), null);
    assert.equal(commands.stop(60, "stop").actionId, "stop-1");
    commands.stop(60.9, "stop", false);
    assert.equal(commands.isUnconfirmed(60.9), false);
    assert.equal(commands.isUnconfirmed(61.1), true);
  });
});

describe("the transport", () => {
  const rig = ({ linkOpen = true } = {}) => {
    const sent = [];
    const router = new TransportRouter({
      link: { send: (frame) => linkOpen && Boolean(sent.push(["datachannel", frame])) },
      socket: { send: (frame, options) => Boolean(sent.push(["mqtt", frame, options])) },
      clockSync: new ClockSync(),
      commands: stream(),
    });
    return { router, sent };
  };
  const echo = ({ router }, way, n, now) =>
    router.clockSync.heard(
      way,
      { n: 1, stamp: now, echoes: [{ peer: "p", n, stamp: now - 0.02, received: now - 0.01 }] },
      "p",
      now,
    );

  test("of velocities is the WebSocket unless the robot echoes the data channel", () => {
    const one = rig();
    one.router.commands.intend(AHEAD);
    one.router.beat(1, null);
    one.sent.length = 0;
    one.router.sendVelocity(1.05, null);
    echo(one, "datachannel", 0, 1.1);
    one.router.sendVelocity(1.15, null);
    one.router.sendVelocity(1.65, null);
    assert.deepEqual(
      one.sent.map(([way]) => way),
      ["mqtt", "datachannel", "mqtt"],
    );
    assert.deepEqual(
      one.sent.map(([, frame]) => JSON.parse(frame.split("\n")[1]).seq),
      [1, 2, 3],
    );
  });

  test("the server learns once each whether the robot's messages arrive directly", () => {
    const one = rig();
    const told = () => one.sent.splice(0).map(([way, frame]) => [way, ...frame.split("\n")]);
    one.router.tellDirect(1);
    assert.deepEqual(told(), []);
    echo(one, "datachannel", 0, 1.1);
    one.router.tellDirect(1.2);
    one.router.tellDirect(1.4);
    assert.deepEqual(told(), [["mqtt", "page/direct", '{"direct":true}']]);
    one.router.direct = false;
    one.router.tellDirect(1.5);
    assert.deepEqual(told(), [["mqtt", "page/direct", '{"direct":true}']]);
    one.router.tellDirect(1.9);
    assert.deepEqual(told(), [["mqtt", "page/direct", '{"direct":false}']]);
  });

  test("a data channel that cannot take a command passes it to the WebSocket", () => {
    const one = rig({ linkOpen: false });
    one.router.commands.intend(AHEAD);
    one.router.beat(1, null);
    echo(one, "datachannel", 0, 1.1);
    one.sent.length = 0;
    one.router.sendVelocity(1.15, null);
    assert.deepEqual(
      one.sent.map(([way, , options]) => [way, options]),
      [["mqtt", { droppable: true }]],
    );
  });

  test("a pointer takes the transport of commands only, and is never queued", () => {
    const dot = { session: "s1", epoch: 3, stamp: 1.15, at: [0.5, 0.25] };
    const one = rig();
    one.router.sendPointer(1, dot);
    one.router.beat(1, null);
    echo(one, "datachannel", 0, 1.1);
    one.sent.length = 0;
    one.router.sendPointer(1.15, dot);
    one.router.sendPointer(1.65, dot);
    assert.deepEqual(
      one.sent.map(([way, frame, options]) => [way, frame.split("\n")[0], options]),
      [
        ["datachannel", "command/point", undefined],
        ["mqtt", "command/point", { droppable: true }],
      ],
    );
    assert.deepEqual(JSON.parse(one.sent[0][1].split("\n")[1]), dot);
    const behind = rig({ linkOpen: false });
    behind.router.only = "datachannel";
    behind.router.sendPointer(1, dot);
    assert.deepEqual(behind.sent, []);
  });

  test("a stop and its repetitions take both transports at once", () => {
    const { router, sent } = rig();
    router.stop(1, "stop");
    router.repeatStop(1.05);
    assert.deepEqual(
      sent.map(([way]) => way),
      ["datachannel", "mqtt", "datachannel", "mqtt"],
    );
    assert.equal(
      new Set(sent.map(([, frame]) => JSON.parse(frame.split("\n")[1]).actionId)).size,
      1,
    );
  });

  test("a heartbeat is sent on each transport with its number", () => {
    const { router, sent } = rig();
    router.beat(1, 0.04);
    router.beat(1.2, null);
    const beats = sent.map(([way, frame]) => [way, JSON.parse(frame.split("\n")[1]).n]);
    assert.deepEqual(beats, [
      ["datachannel", 0],
      ["mqtt", 1],
      ["datachannel", 2],
      ["mqtt", 3],
    ]);
  });

  test("the decoder of the page does not accept what the page sends", () => {
    const { router, sent } = rig();
    router.stop(1, "stop");
    assert.throws(() => decodePacket(sent[0][1]));
  });
});
