"""Sockets of the embedded broker: turns, allowances, and those who have not said who they are."""

import asyncio
import contextlib
import gc
import itertools
import socket
import ssl
from collections import Counter
from dataclasses import dataclass
from typing import Any

import pytest

from robots.api.topics import of
from robots.broker import connection as connection_module
from robots.broker import packets
from robots.broker.admission import MAX_STRANGERS
from robots.broker.bounded_log import LINES_OF_SUBJECT
from robots.broker.connection import CONNECT_BYTES, PACKETS_A_TURN, ClientConnection
from robots.broker.embedded import ACCEPTED_A_TURN, EmbeddedBroker
from robots.broker.permissions import ROBOT_ALLOWANCE, BrokerUser, of_robot, of_server
from robots.broker.token_bucket import TokenBucket
from robots.enrol.credentials import hash_token
from tests.support.patience import patient
from tests.support.programs.server import certificate
from tests.support.sessions.broker_rig import RawClient, connect_packet, framed

PING, PONG = b"\xc0\x00", (0xD0, b"")
LEASE = of("giraff", "lease")


@dataclass
class Door:
    """A running broker; `web` and `giraff` have the token `token`."""

    broker: EmbeddedBroker
    port: int
    tls: ssl.SSLContext | None
    reads: list[None]

    async def enter(self):
        return RawClient(*await asyncio.open_connection("127.0.0.1", self.port, ssl=self.tls))

    async def signed_in(self, user="web", client_id="c"):
        client = await self.enter()
        assert await client.connect(user, "token", client_id=client_id) == packets.ACCEPTED
        return client

    async def silent(self):
        """Return somebody who says nothing, also nothing of TLS."""
        return RawClient(*await asyncio.open_connection("127.0.0.1", self.port))

    def connection(self, client_id):
        return next(
            c
            for c in self.broker.connections
            if c.session is not None and c.session.client_id == client_id
        )

    async def until(self, question):
        async with asyncio.timeout(patient(10)):
            while not question():
                await asyncio.sleep(0.001)


@pytest.fixture(params=["plain", "tls"])
async def door(request, tmp_path, monkeypatch):
    # on a busy computer nobody goes by themselves meanwhile
    monkeypatch.setattr(connection_module, "CONNECT_SECONDS", 600.0)
    monkeypatch.setattr("robots.broker.embedded.REFRESH_SECONDS", 0.0)
    users = {
        name: BrokerUser(name, hash_token("token"), may)
        for name, may in (("web", of_server()), ("giraff", of_robot("giraff")))
    }
    reads = []

    async def read():
        reads.append(None)
        return users

    serving = asking = None
    if request.param == "tls":
        key, chain = certificate(tmp_path)
        serving, asking = (
            ssl.create_default_context(ssl.Purpose.CLIENT_AUTH),
            ssl.create_default_context(cafile=str(chain)),
        )
        serving.load_cert_chain(chain, key)
    broker = EmbeddedBroker(read, poll=600.0)
    yield Door(broker, await broker.start("127.0.0.1", 0, serving), asking, reads)
    await broker.stop()


@pytest.fixture
async def turns_of_the_loop():
    """Count the turns of the loop while a test runs."""
    count: list[int] = [0]

    async def turn():
        while True:
            count[0] += 1
            await asyncio.sleep(0)

    turning = asyncio.create_task(turn())
    yield lambda: count[0]
    turning.cancel()


def noted(monkeypatch, of_class: Any, method: str, note: Any) -> list[Any]:
    """Note something of each call of a method, and call it."""
    notes: list[Any] = []
    original = getattr(of_class, method)

    def wrapped(self, *arguments):
        notes.append(note(self, *arguments))
        return original(self, *arguments)

    monkeypatch.setattr(of_class, method, wrapped)
    return notes


# --- fair turns -----------------------------------------------------------------------------------


async def test_of_a_flood_a_few_packets_are_handled_in_a_turn_of_the_loop(
    door, monkeypatch, turns_of_the_loop
):
    client = await door.signed_in()
    handled = noted(monkeypatch, ClientConnection, "_obey", lambda *_: turns_of_the_loop())
    client.send(PING * 5000)
    for _ in range(5000):
        assert await client.packet() == PONG
    assert max(Counter(handled).values()) == PACKETS_A_TURN


async def test_others_have_their_turn_between_those_of_a_flood_and_nothing_more_is_read_meanwhile(
    door, monkeypatch
):
    flooder, honest = (
        await door.signed_in(client_id="flooder"),
        await door.signed_in(client_id="honest"),
    )
    handled = noted(
        monkeypatch, ClientConnection, "_obey", lambda connection, *_: connection.session.client_id
    )
    waiting = noted(
        monkeypatch,
        ClientConnection,
        "_take_turn",
        lambda connection, *_: len(connection._reader._buffer),
    )
    flooder.send(PING * 100_000)
    await door.until(lambda: handled)
    honest.send(PING)
    assert await honest.packet() == PONG
    assert "honest" in handled[:2000], "it did not wait for the flood"
    assert max(waiting) < 2 * connection_module.READ_BYTES, (
        "what was not handled stays with its sender"
    )


async def test_a_robot_that_has_had_its_allowance_is_not_read_any_more_and_the_others_are(
    door, monkeypatch
):
    robots = [await door.signed_in("giraff", f"robot-{number}") for number in range(2)]
    web = await door.signed_in("web")
    handled = noted(
        monkeypatch, ClientConnection, "_obey", lambda connection, *_: connection.session.client_id
    )
    connections = [door.connection(f"robot-{number}") for number in range(2)]
    connections[0]._usage.bucket = bucket = TokenBucket(1e-6, 50.0, 0.0)
    connections[1]._usage.bucket = bucket
    for robot in robots:
        robot.send(PING * 1000)
    await door.until(lambda: len(handled) >= 50)
    web.send(PING)
    assert await web.packet() == PONG
    await door.until(
        lambda: not any(connection.transport.is_reading() for connection in connections)
    )
    assert Counter(name == "c" for name in handled) == {False: 50, True: 1}, (
        "both connections of the robot share what it has"
    )


async def test_a_flood_of_a_robot_is_handled_in_full_as_its_allowance_comes_in(door):
    robot = await door.signed_in("giraff")
    for _ in range(2):
        robot.send(PING * 1500)
        for _ in range(1500):
            assert await robot.packet() == PONG


async def test_of_one_robot_the_oldest_connection_goes_when_there_are_too_many(door):
    clients = [
        await door.signed_in("giraff", f"c{number}")
        for number in range(ROBOT_ALLOWANCE.connections)
    ]
    for number in range(2):
        clients.append(await door.signed_in("giraff", f"later-{number}"))
        assert await clients[number].is_hung_up()
    for client in clients[2:]:
        client.send(PING)
        assert await client.packet() == PONG


async def test_who_asks_and_never_takes_the_answers_is_sent_away(door, monkeypatch):
    monkeypatch.setattr(connection_module, "MAX_UNSENT", 64 * 1024)
    client = await door.signed_in(client_id="greedy")
    web = await door.signed_in(client_id="web")
    client.writer.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    greedy = door.connection("greedy")
    greedy.transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
    client.writer.transport.pause_reading()

    async def ask():
        while greedy in door.broker.connections:
            client.send(PING * 10_000)
            await client.writer.drain()

    with contextlib.suppress(ConnectionError):
        async with asyncio.timeout(patient(30)):
            await ask()
    await door.until(lambda: greedy not in door.broker.connections)
    web.send(PING)
    assert await web.packet() == PONG


# --- before the password --------------------------------------------------------------------------


async def test_of_a_stranger_not_one_byte_behind_the_connect_is_read_before_the_password_is_known(
    door, monkeypatch
):
    read = noted(monkeypatch, ClientConnection, "buffer_updated", lambda _, count: count)
    asked, answer = asyncio.Event(), asyncio.Event()
    original = door.broker.authenticate

    async def slow(connect, address):
        asked.set()
        await answer.wait()
        return await original(connect, address)

    monkeypatch.setattr(door.broker, "authenticate", slow)
    connect = connect_packet("stranger", "web", "wrong")
    stranger = await door.enter()
    stranger.send(connect + PING * 120_000)
    await asked.wait()
    (connection,) = door.broker.connections
    assert not connection.transport.is_reading()
    assert sum(read) == len(connect)
    answer.set()
    assert await stranger.is_hung_up()  # by a reset, as there is more than anybody will read
    assert sum(read) == len(connect)


async def test_what_is_sent_behind_the_connect_is_read_when_the_password_was_right(door):
    for _ in range(2):
        client = await door.enter()
        client.send(connect_packet("eager", "web", "token") + PING * 3)
        assert [await client.packet() for _ in range(4)] == [(0x20, b"\x00\x00"), PONG, PONG, PONG]


async def test_the_broker_looks_at_one_connect_in_a_turn_of_its_loop(
    door, monkeypatch, turns_of_the_loop
):
    looked = noted(monkeypatch, ClientConnection, "sign_in", lambda _: turns_of_the_loop())
    clients = [await door.enter() for _ in range(30)]
    for number, client in enumerate(clients):
        client.send(connect_packet(f"c{number}", "web", "token"))
    for client in clients:
        assert await client.packet() == (0x20, b"\x00\x00")
    assert len(looked) == len(set(looked)) == len(clients)


async def test_a_few_connections_are_accepted_in_a_turn_and_many_may_wait(
    door, monkeypatch, turns_of_the_loop
):
    made = noted(monkeypatch, ClientConnection, "connection_made", lambda *_: turns_of_the_loop())
    # the loop stands meanwhile: the kernel takes them
    sockets = [socket.create_connection(("127.0.0.1", door.port)) for _ in range(100)]
    await door.until(lambda: len(made) == len(sockets))
    assert max(Counter(made).values()) <= ACCEPTED_A_TURN
    for one in sockets:
        one.close()


async def test_a_neighbour_of_many_silent_strangers_gets_in_and_the_oldest_of_them_goes(door):
    known = await door.signed_in(client_id="known")
    silent = [await door.silent() for _ in range(MAX_STRANGERS)]
    await door.until(lambda: door.broker.admission.strangers == MAX_STRANGERS)
    for number in range(2):
        await door.signed_in(client_id=f"neighbour-{number}")
        assert await silent[number].is_hung_up()
        assert door.broker.admission.strangers == MAX_STRANGERS - 1, (
            "who is signed in counts no more"
        )
        silent.append(await door.silent())
        await door.until(lambda: door.broker.admission.strangers == MAX_STRANGERS)
    known.send(PING)
    assert await known.packet() == PONG, "it is still served"
    for client in silent:
        client.abort()
    await door.until(lambda: not door.broker.admission.strangers)


async def test_more_silent_strangers_than_places_leave_room_for_neighbours_all_the_same(door):
    silent = []
    for number in range(3):
        silent += [await door.silent() for _ in range(MAX_STRANGERS)]
        await door.signed_in(client_id=f"neighbour-{number}")
    assert len(door.broker.connections) <= MAX_STRANGERS + 3
    for client in silent:
        client.abort()


async def test_a_stranger_that_never_says_anything_is_hung_up_on_also_in_the_handshake_of_tls(
    door, monkeypatch
):
    monkeypatch.setattr(connection_module, "CONNECT_SECONDS", 0.2)
    silent = await door.silent()
    assert await silent.is_hung_up()
    await door.until(lambda: not door.broker.connections and not door.broker.admission.strangers)


async def test_a_stranger_who_talks_no_tls_is_hung_up_on_and_forgotten(door):
    if door.tls is None:
        return
    for data in (connect_packet("plain", "web", "token"), b"\x16\x03\x01" + bytes(500)):
        plain = await door.silent()
        plain.send(data)
        assert await plain.is_hung_up()
    gone = await door.silent()
    gone.abort()
    await door.until(lambda: not door.broker.connections and not door.broker.admission.strangers)


async def test_connections_that_ended_hold_no_memory_until_the_collector_comes(door):
    async def come(number):
        known, stranger, silent = await door.enter(), await door.enter(), await door.silent()
        assert await known.connect("web", "token", client_id=f"c{number}") == packets.ACCEPTED
        assert await stranger.connect("web", "wrong") == packets.BAD_PASSWORD
        for client in (known, stranger, silent):
            client.abort()

    await come(0)
    await door.until(lambda: not door.broker.connections)
    gc.collect()
    gc.disable()
    try:
        for number in range(1, 4):
            await come(number)
        await door.until(lambda: not door.broker.connections)
        await door.until(lambda: not kept(door))
    finally:
        gc.enable()


def kept(door):
    """Return the connections that are in memory."""
    found = [c for c in gc.get_objects() if isinstance(c, ClientConnection)]
    return [c for c in found if c._desk is door.broker]


async def test_nor_do_those_that_asyncio_says_have_ended_in_their_handshake(door):
    if door.tls is None:
        return
    gc.collect()
    gc.disable()
    try:
        client = await door.silent()
        await door.until(lambda: door.broker.connections)
        await asyncio.sleep(0.05)  # the handshake has begun
        next(iter(door.broker.connections)).connection_lost(None)
        client.abort()
        await door.until(lambda: not kept(door))
    finally:
        gc.enable()


async def test_whoever_guesses_beside_a_robot_keeps_it_from_nothing_and_asks_the_database_no_more(
    door, caplog
):
    for number in range(30):
        stranger = await door.enter()
        assert (
            await stranger.connect(f"nobody-{number}" if number % 2 else "giraff", "wrong")
            == packets.BAD_PASSWORD
        )
    assert len(door.reads) <= 12, "one at the start, and one for each of the first that were wrong"
    await door.signed_in("giraff")
    refused = [
        record
        for record in caplog.records
        if record.getMessage().startswith("broker_password_refused")
    ]
    assert len(refused) == LINES_OF_SUBJECT


async def test_nothing_long_is_kept_of_a_packet_before_its_sender_is_let_in(door):
    stranger, friend = await door.enter(), await door.signed_in()
    stranger.send(connect_packet("long", "web", b"x" * 0xFFFF)[:CONNECT_BYTES])
    assert await stranger.is_hung_up()
    friend.send(
        framed(
            0x32,
            len(LEASE).to_bytes(2, "big") + LEASE.encode() + b"\x00\x07" + bytes(2 * CONNECT_BYTES),
        )
    )
    assert await friend.packet() == (0x40, b"\x00\x07")


async def test_a_robot_that_comes_again_and_again_is_told_to_wait_and_is_let_in_later(door):
    codes = []
    for number in itertools.count():
        client = await door.enter()
        codes.append(await client.connect("giraff", "token", client_id=f"c{number}"))
        client.abort()
        if codes[-1] != packets.ACCEPTED:
            break
        door.broker.admission.usage(door.broker._users["giraff"], 0.0).bucket.take(
            200.0, asyncio.get_running_loop().time()
        )
    assert codes[-1] == packets.UNAVAILABLE
    async with asyncio.timeout(patient(10)):
        while await (await door.enter()).connect("giraff", "token") != packets.ACCEPTED:
            await asyncio.sleep(0.05)
