import assert from "node:assert/strict";
import { mock, test } from "node:test";

import { Socket } from "../../../static/js/protocol/socket.js";
import { backoff } from "../../../static/js/lib/backoff.js";
import { unixNow } from "../../../static/js/lib/clock.js";
import { freshId } from "../../../static/js/lib/ids.js";

const rig = () => {
  const dialled = [];
  const log = [];
  const socket = new Socket({
    url: "ws://robot/",
    onPacket: (frame) => log.push(`frame ${frame}`),
    onOpen: () => log.push("open"),
    onLost: (code) => log.push(`lost ${code}`),
    connect: () => {
      const one = {
        readyState: 0,
        bufferedAmount: 0,
        sent: [],
        send: (frame) => one.sent.push(frame),
        close: () => (one.closed = true),
      };
      dialled.push(one);
      return one;
    },
  });
  const open = (one) => {
    one.readyState = 1;
    one.onopen();
  };
  return { socket, dialled, log, open };
};

test("reconnects for ever with growing pauses that reset after a connection", (context) => {
  context.mock.timers.enable({ apis: ["setTimeout"] });
  const { socket, dialled, open } = rig();
  socket.open();
  for (let i = 0; i < 8; i += 1) {
    dialled.at(-1).onclose({ code: 1006 });
    context.mock.timers.tick(5000);
    assert.equal(dialled.length, i + 2);
  }
  open(dialled.at(-1));
  assert.equal(socket.attempt, 0);
  socket.close();
});

test("a closed socket is not dialled again", (context) => {
  context.mock.timers.enable({ apis: ["setTimeout"] });
  const { socket, dialled } = rig();
  socket.open();
  socket.close();
  dialled[0].onclose({ code: 1000 });
  context.mock.timers.tick(60_000);
  assert.equal(dialled.length, 1);
});

test("packets of an abandoned socket are ignored", (context) => {
  context.mock.timers.enable({ apis: ["setTimeout"] });
  const { socket, dialled, log, open } = rig();
  socket.open();
  open(dialled[0]);
  socket.redial();
  dialled[0].onmessage({ data: "late" });
  dialled[0].onclose({ code: 1006 });
  assert.deepEqual(log, ["open", "lost 1006"]);
  context.mock.timers.tick(1000);
  assert.equal(dialled.length, 2);
  socket.close();
});

test("a silent open socket is dialled again", (context) => {
  context.mock.timers.enable({ apis: ["setTimeout"] });
  const { socket, dialled, log, open } = rig();
  socket.open();
  assert.equal(socket.watch(unixNow() + 60), 0);
  open(dialled[0]);
  socket.watch(socket.receivedAt + 2);
  assert.deepEqual(log, ["open"]);
  assert.equal(Math.round(socket.watch(socket.receivedAt + 4)), 4);
  context.mock.timers.tick(5000);
  assert.deepEqual(log, ["open", "lost 1006"]);
  assert.equal(dialled.length, 2);
  socket.close();
});

test("a message is dropped without a connection, or if it would wait too long", () => {
  const { socket, dialled, open } = rig();
  socket.open();
  assert.equal(socket.send("a"), false);
  open(dialled[0]);
  assert.equal(socket.send("b"), true);
  dialled[0].bufferedAmount = 10 ** 6;
  assert.equal(socket.send("c", { droppable: true }), false);
  assert.equal(socket.send("stop"), true);
  assert.deepEqual(dialled[0].sent, ["b", "stop"]);
  socket.close();
});

test("pauses grow up to a bound, and are random", () => {
  const whole = [0, 1, 2, 3, 30].map((attempt) => backoff(attempt, { random: () => 1 }));
  assert.deepEqual(whole, [0.25, 0.5, 1, 2, 5]);
  assert.equal(backoff(2, { random: () => 0 }), 0.5);
});

test("an id has the form of the Robot API, and is unique", () => {
  const ids = new Set(Array.from({ length: 100 }, () => freshId("stop-")));
  assert.equal(ids.size, 100);
  assert.ok([...ids].every((id) => /^[A-Za-z0-9_-]{1,64}$/.test(id)));
  mock.reset();
});
