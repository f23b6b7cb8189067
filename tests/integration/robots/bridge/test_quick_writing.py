"""Messages that are written directly into the socket of a client."""

import asyncio
import collections
import contextlib
import random
import socket

import pytest
from paho.mqtt.client import Client

from robots.api import messages as m
from robots.bridge.bridge import Bridge
from robots.bridge.quick_writing import MAX_PENDING, QuickWriter, writer_of
from tests.support.architectures.mqtt_ear import Ear
from tests.support.patience import patient
from tests.support.sessions.recorder_rig import running_mosquitto
from tests.support.words import velocity


def lease(stamp):
    return m.Lease(session="s1", epoch=3, peer="p1", who="Ada", renewal=0, stamp=stamp)


class Paho:
    """The part of paho that a writer uses: a queue of unsent bytes."""

    _pack_remaining_length = Client._pack_remaining_length

    def __init__(self):
        self._out_packet = collections.deque()

    def _packet_queue(self, _command, packet, _mid, _qos):
        self._out_packet.append(packet)


@pytest.fixture
def pair():
    with contextlib.ExitStack() as stack:
        ours, theirs = (stack.enter_context(end) for end in socket.socketpair())
        ours.setblocking(False)
        theirs.setblocking(False)
        yield ours, theirs


def drained(theirs):
    found = b""
    with contextlib.suppress(BlockingIOError):
        while piece := theirs.recv(1 << 20):
            found += piece
    return found


def test_slow_broker_gets_all_bytes_in_order_up_to_a_bound(
    pair,
):
    ours, theirs = pair
    paho, written = Paho(), 0
    writer = QuickWriter(paho, ours)
    while writer.publish("t", written.to_bytes(2, "big") * 5000):
        written += 1
    assert len(paho._out_packet) == MAX_PENDING
    arrived = drained(theirs)
    while paho._out_packet:  # as paho does when the socket has room
        rest = paho._out_packet.popleft()
        sent = ours.send(rest)
        if sent < len(rest):
            paho._out_packet.appendleft(rest[sent:])
        arrived += drained(theirs)
    assert arrived == b"".join(
        b"\x30\x93\x4e\x00\x01t" + number.to_bytes(2, "big") * 5000 for number in range(written)
    )


def test_publishing_on_a_closed_socket_returns_false(pair):
    ours, _ = pair
    writer = QuickWriter(Paho(), ours)
    assert writer.publish("t", b"1")
    ours.close()
    assert not writer.publish("t", b"2")


def test_unknown_client_gets_no_writer():
    assert writer_of(object()) is None


def received(ear):
    """Return the numbers of the velocities, and the leases."""
    return [
        message.seq if suffix == "command/velocity" else f"lease {message.stamp:.0f}"
        for suffix, message, _ in ear.heard
    ]


@pytest.mark.broker
@pytest.mark.parametrize("quick", [True, False])
async def test_commands_arrive_in_order_after_earlier_messages(quick, monkeypatch):
    """Fails with `quick` when paho or aiomqtt no longer are as robots/bridge/quick_writing.py
    assumes.
    """
    if not quick:
        monkeypatch.setattr("robots.bridge.bridge.writer_of", lambda _: None)
    with running_mosquitto() as broker, Ear(broker.port) as ear:
        bridge = Bridge(broker.url, ("web", "secret"), random.Random(1))
        assert await bridge.wait_connected(patient(10))
        assert (bridge._writer is not None) == quick
        for number in range(1, 6):
            bridge.publish_lease("giraff", lease(float(number)))
            for seq in range(number * 10, number * 10 + 5):
                assert bridge.send("giraff", "command/velocity", velocity(seq))
            await asyncio.to_thread(
                ear.wait,
                "command/velocity",
                lambda command, last=number * 10 + 4: command.seq == last,
            )
        for seq in range(100, 150):
            bridge.send("giraff", "command/velocity", velocity(seq))
        await asyncio.to_thread(ear.wait, "command/velocity", lambda command: command.seq == 149)
        await bridge.close()
    expected = [
        entry
        for number in range(1, 6)
        for entry in (f"lease {number}", *range(number * 10, number * 10 + 5))
    ]
    assert received(ear) == [*expected, *range(100, 150)]


@pytest.mark.broker
async def test_commands_do_not_wait_for_confirmations_of_the_broker():
    """Otherwise one report per second and page would delay the commands of all pages."""
    with running_mosquitto() as broker, Ear(broker.port) as ear:
        bridge = Bridge(broker.url, ("web", "secret"), random.Random(1))
        assert await bridge.wait_connected(patient(10))
        bridge.publish_lease("giraff", lease(1.0))
        bridge.send("giraff", "command/velocity", velocity(1))
        assert len(bridge._in_flight) == 2, "the client has not taken the lease yet"
        await asyncio.sleep(0)
        bridge.send("giraff", "command/velocity", velocity(2))
        assert len(bridge._in_flight) == 2, "one of them is confirmed"
        await asyncio.to_thread(ear.wait, "command/velocity", lambda command: command.seq == 2)
        await bridge.close()
    assert received(ear) == ["lease 1", 1, 2]
