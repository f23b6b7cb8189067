"""A client that reads in large pieces."""

import asyncio
import contextlib
import socket
from types import SimpleNamespace

import aiomqtt
import paho.mqtt.client
import pytest

from robots.bridge.quick_reading import CHUNK, _Pieces, read_quickly
from tests.support.patience import patient
from tests.support.sessions.recorder_rig import HOST, running_mosquitto


@pytest.mark.broker
@pytest.mark.parametrize("chunk", [CHUNK, 4096])
async def test_messages_of_all_sizes_arrive_in_order(chunk):
    """Fails when paho or aiomqtt no longer are as robots/bridge/quick_reading.py assumes."""
    sizes = [1, 20, 70_000, 3, 200_000, *([500] * 2000), 65_535, 65_536, 2]
    with running_mosquitto() as broker:
        async with (
            aiomqtt.Client(HOST, broker.port, timeout=patient(30)) as reader,
            aiomqtt.Client(
                HOST, broker.port, timeout=patient(30), max_inflight_messages=100
            ) as writer,
        ):
            assert read_quickly(reader, chunk)
            await reader.subscribe("t", 1)
            writer.pending_calls_threshold = 10_000
            publishing = asyncio.gather(
                *(
                    writer.publish("t", bytes([number % 251]) * size, 1)
                    for number, size in enumerate(sizes)
                )
            )
            got = []
            async with asyncio.timeout(patient(30)):
                async for message in reader.messages:
                    got.append((len(message.payload), message.payload[0]))
                    if len(got) == len(sizes):
                        break
            await publishing
            await reader.publish("elsewhere", b"x" * 100_000, 1)
    assert got == [(size, number % 251) for number, size in enumerate(sizes)]


class Decrypted:
    """Like a TLS connection, which decrypts a record as a whole: its unread rest does not make the
    socket readable again.
    """

    def __init__(self, record: bytes) -> None:
        self.left = record

    def pending(self) -> int:
        return len(self.left)


async def test_rest_of_a_tls_record_is_read_at_once():
    ours = Decrypted(b"a" * 10_000)
    got = []

    class Paho:
        _in_packet = {"command": 0}

        def _sock_recv(self, size):
            part, ours.left = ours.left[:size], ours.left[size:]
            return part

        def loop_read(self, _):
            with contextlib.suppress(BlockingIOError):
                got.append(pieces.receive(100))
            return 0

    pieces = _Pieces(Paho(), 4096, ours.pending)
    pieces.read_all()
    assert len(b"".join(got)) == 4096, "one piece per turn of the loop"
    for _ in range(5):
        await asyncio.sleep(0)
    assert b"".join(got) == b"a" * 10_000


def test_one_turn_of_the_loop_reads_one_piece_and_the_packet_in_which_it_ends():
    size, count = 500, 150
    client = paho.mqtt.client.Client(paho.mqtt.client.CallbackAPIVersion.VERSION2)
    got = []
    client.on_message = lambda _client, _userdata, message: got.append(message.payload)
    ours, theirs = socket.socketpair()
    with ours, theirs:
        ours.setblocking(False)
        client._sock = ours
        sent = [bytes([number]) * size for number in range(count)]
        theirs.sendall(b"".join(b"\x30\xf7\x03\x00\x01t" + payload for payload in sent))
        assert read_quickly(SimpleNamespace(_client=client), 4096)
        turns = []
        while len(got) < count:
            before = len(got)
            assert client.loop_read() == 0
            turns.append(len(got) - before)
    assert got == sent
    assert max(turns) <= 4096 // size + 1
    assert min(turns) >= 1
