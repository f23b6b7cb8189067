"""Frames that wait for a slow page."""

import asyncio
import time

import pytest

from sessions import protocol
from sessions.consumers.relay import Outgoing
from sessions.consumers.send_queue import SendQueue
from sessions.consumers.sender import Sender
from tests.support.host_jitter import watched
from tests.support.patience import until


async def test_frames_keep_their_order():
    queue = SendQueue()
    for number in range(10):
        queue.put(str(number), droppable=number % 3 == 0)
    assert [await queue.take() for _ in range(10)] == [str(number) for number in range(10)]


async def test_only_the_oldest_telemetry_is_dropped():
    queue = SendQueue(droppable=3, kept=100)
    for number in range(10):
        queue.put(f"state {number}", droppable=True)
        queue.put(f"event {number}", droppable=False)
    frames = [await queue.take() for _ in range(13)]
    states, events = ([f for f in frames if f.startswith(kind)] for kind in ("state", "event"))
    assert states == ["state 7", "state 8", "state 9"]
    assert events == [f"event {number}" for number in range(10)]
    assert frames[-2:] == ["state 9", "event 9"]
    assert queue.dropped == 7


async def test_a_frame_wakes_the_waiting_task():
    queue = SendQueue()
    taking = asyncio.create_task(queue.take())
    await queue.wait_empty(5.0)
    assert queue.put("x", droppable=True)
    assert await taking == "x"


class Wire:
    """A network that takes frames only while it is open."""

    def __init__(self):
        self.sent, self.codes, self.full = [], [], False

    async def send(self, frame):
        self.sent.append(frame)

    async def close(self, code):
        self.codes.append(code)


@pytest.fixture
async def network():
    network = Wire()
    network.sender = Sender(network.send, network.close, lambda: network.full)
    yield network
    network.sender.abandon()


async def test_old_telemetry_is_replaced_while_the_network_is_full(network):
    network.full = True
    network.sender.put(Outgoing("first"))
    await until(lambda: network.sent)
    for number in range(200):
        network.sender.put(Outgoing(f"state {number}", droppable=True))
    network.full = False
    await until(lambda: len(network.sent) == 65)
    assert network.sent[1] == "state 136"


async def test_a_page_with_too_many_waiting_frames_is_disconnected(network):
    network.full = True
    for number in range(600):
        network.sender.put(Outgoing(f"event {number}"))
    await until(lambda: network.codes)
    assert network.codes == [protocol.TOO_SLOW]


async def test_waiting_frames_are_sent_before_the_connection_is_closed_once(network):
    network.sender.put(Outgoing("you may go"))
    network.sender.end(protocol.NOT_ALLOWED)
    network.sender.end(protocol.SIGNED_OUT)
    await until(lambda: network.codes)
    assert (network.sent, network.codes) == (["you may go"], [protocol.NOT_ALLOWED])


async def test_closing_does_not_wait_for_a_page_that_reads_nothing(network, monkeypatch):
    monkeypatch.setattr("sessions.consumers.sender.DRAIN_SECONDS", 0.05)
    network.full = True
    for word in ("one", "two"):
        network.sender.put(Outgoing(word))
    with watched() as computer:
        began = time.time()
        network.sender.end(protocol.NOT_ALLOWED)
        await until(lambda: network.codes)
        ended = time.time()
        assert ended - began < 2.0 + computer.excuse(began, ended)
    assert network.sent == ["one"]


async def test_only_the_newest_picture_waits(network):
    network.full = True
    network.sender.put(Outgoing("first"))
    await until(lambda: network.sent)
    for number in range(500):
        network.sender.put_picture(b"picture %d" % number)
    assert len(network.sender.queue) == 1
    assert network.sender.queue.dropped == 499
    network.full = False
    await until(lambda: len(network.sent) == 2)
    assert network.sent[1] == b"picture 499"


async def test_pictures_do_not_displace_other_frames():
    queue = SendQueue()
    queue.put("state", droppable=True)
    queue.put_picture(b"old")
    queue.put("event", droppable=False)
    queue.put_picture(b"new")
    assert [await queue.take() for _ in range(3)] == ["state", "event", b"new"]
