"""A real broker, users that the test creates, clients of these users, and a client that may violate
the protocol.
"""

import asyncio
import contextlib
import os
import time
from dataclasses import dataclass, field
from pathlib import Path

import aiomqtt

from robots.broker.engines import ENGINES
from robots.broker.listeners import Listeners
from robots.broker.permissions import BrokerUser, of_robot, of_server
from robots.broker.server import BrokerServer
from robots.enrol.credentials import bcrypt_hash, hash_token, new_token
from tests.support.clustered_brokers import engines
from tests.support.patience import patient
from tests.support.sessions.site import free_port

KINDS = tuple(os.environ.get("BROKERS", "nats,mosquitto").split(","))
POLL = 0.1
HOST = "127.0.0.1"
ACCEPTED, BAD_PASSWORD, NOT_AUTHORIZED = 0, 4, 5  # return codes of CONNACK
SECONDS = 30.0  # how long a test waits for a message or the end of a connection


async def until_thrown_out(client: aiomqtt.Client) -> None:
    """Read a client's messages until the broker disconnects it."""
    with contextlib.suppress(aiomqtt.MqttError):
        async with asyncio.timeout(patient(SECONDS)):
            async for _ in client.messages:
                pass
        raise AssertionError("the messages ended without an error")


class PasswordClients:
    """Clients of a broker on `port`, by user and password."""

    port: int

    def client(self, user, password, **options):
        return aiomqtt.Client(
            HOST, self.port, username=user, password=password, timeout=SECONDS, **options
        )

    async def lets_in(self, user, password):
        with contextlib.suppress(aiomqtt.MqttError):
            async with self.client(user, password):
                return True
        return False

    async def until_let_in(self, user, password):
        await BrokerRig.until(lambda: self.lets_in(user, password))


@dataclass
class BrokerRig:
    """Start with `start`, end with `stop`. `web` is a server's user; `robot` adds a robot's."""

    kind: str
    directory: Path
    users: dict[str, BrokerUser] = field(default_factory=dict)
    tokens: dict[str, str] = field(default_factory=dict)
    # no other process gets it while a restarting broker is away
    port: int = field(default_factory=free_port)

    async def start(self):
        self.add("web", of_server())
        await self._start()

    async def _start(self):
        self.broker = self._broker()
        self.port = await self.broker.start(Listeners(HOST, self.port))
        self._running = asyncio.create_task(self.broker.wait())

    def _broker(self):
        return BrokerServer(ENGINES[self.kind], self._read, self.directory, poll=POLL)

    async def stop(self):
        self._running.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await self._running
        await self.broker.stop()

    async def restart(self):
        await self.stop()
        await self._start()

    async def _read(self):
        return dict(self.users)

    def add(self, name, permissions):
        self.tokens[name] = new_token()
        token = self.tokens[name]
        self.users[name] = BrokerUser(name, hash_token(token), permissions, bcrypt_hash(token))

    async def robot(self, name):
        """Add a robot and wait until the broker lets it in."""
        self.add(name, of_robot(name))
        await self.until(lambda: self.is_let_in(name))
        return name

    def revoke(self, name):
        del self.users[name]

    def client(self, user, *, token=None, client_id=None, **options):
        """Return an aiomqtt client of a user, to be used with `async with`."""
        return aiomqtt.Client(
            HOST,
            self.port,
            username=user,
            password=token or self.tokens[user],
            identifier=client_id,
            timeout=SECONDS,
            max_queued_outgoing_messages=0,
            max_inflight_messages=200,
            **options,
        )

    def receiver(self, user, *filters, qos=1, **options):
        """Return a client that subscribes to filters and collects messages, for `async with`."""
        return Receiver(self.client(user, **options), *filters, qos=qos)

    async def is_let_in(self, user, token=None):
        raw = await RawClient.open(self.port)
        try:
            return (
                await raw.connect(
                    user,
                    token or self.tokens.get(user, "?"),
                    client_id=f"probe-{time.monotonic_ns()}",
                )
                == ACCEPTED
            )
        finally:
            raw.abort()

    @staticmethod
    async def until(question):
        """Wait until an async question returns True."""
        async with asyncio.timeout(patient(SECONDS)):
            while not await question():
                await asyncio.sleep(0.02)


class ClusterRig(BrokerRig):
    """A broker of several nodes; each read of its port returns the next node's, so that clients of
    a test communicate across nodes.
    """

    _asked = 0

    def _broker(self):
        if self._kept is None:
            self._kept = engines.make(self.kind, self._read, self.directory, POLL)
        return self._kept

    _kept = None

    @property
    def port(self):
        self._asked += 1
        ports = self._broker().ports
        return ports[self._asked % len(ports)]

    @port.setter
    def port(self, _value):
        """A node has its port from the beginning."""

    async def robot(self, name):
        """Add a robot and wait until every node lets it in."""
        await super().robot(name)
        for _ in self._broker().ports:
            await self.until(lambda: self.is_let_in(name))
        return name


@dataclass
class RawClient:
    """A socket that sends exactly what the test writes."""

    reader: asyncio.StreamReader
    writer: asyncio.StreamWriter

    @classmethod
    async def open(cls, port):
        return cls(*await asyncio.open_connection(HOST, port))

    async def connect(self, user, token, *, client_id="raw", clean=True, keep_alive=60, will=None):
        """Send a CONNECT and return the code of the CONNACK, or None when the broker hung up."""
        self.writer.write(
            connect_packet(client_id, user, token, clean=clean, keep_alive=keep_alive, will=will)
        )
        answer = await self.read(4)
        return answer[3] if answer is not None else None

    async def read(self, count):
        """Return so many bytes, or None at the end."""
        try:
            return await asyncio.wait_for(self.reader.readexactly(count), SECONDS)
        except (asyncio.IncompleteReadError, ConnectionError):
            return None

    async def packet(self):
        """Return (first byte, body) of the next packet, or None when the broker has hung up."""
        first, length, shift = await self.read(1), 0, 0
        while first is not None and (byte := await self.read(1)) is not None:
            length |= (byte[0] & 0x7F) << shift
            shift += 7
            if not byte[0] & 0x80:
                body = await self.read(length)
                return None if body is None else (first[0], body)
        return None

    def send(self, data):
        self.writer.write(data)

    async def is_hung_up(self):
        """Wait until the broker closes the connection."""
        with contextlib.suppress(ConnectionError):
            while await asyncio.wait_for(self.reader.read(65536), SECONDS):
                pass
        return True

    def abort(self):
        """Close the connection without a DISCONNECT."""
        self.writer.transport.abort()


def text(value):
    data = value if isinstance(value, bytes) else value.encode()
    return len(data).to_bytes(2, "big") + data


def framed(first, body):
    length, header = len(body), bytearray([first])
    while True:
        header.append((length & 0x7F) | (0x80 if length > 0x7F else 0))
        length >>= 7
        if not length:
            return bytes(header) + body


def connect_packet(
    client_id, user=None, token=None, *, clean=True, keep_alive=60, will=None, level=4
):
    """Return a CONNECT; `will` is (topic, payload, qos, retain)."""
    flags = (
        (2 if clean else 0) | (0x80 if user is not None else 0) | (0x40 if token is not None else 0)
    )
    payload = text(client_id)
    if will is not None:
        topic, message, qos, retain = will
        flags |= 4 | (qos << 3) | (0x20 if retain else 0)
        payload += text(topic) + text(message)
    payload += b"".join(text(part) for part in (user, token) if part is not None)
    return framed(
        0x10, text("MQTT") + bytes([level, flags]) + keep_alive.to_bytes(2, "big") + payload
    )


def subscribe_packet(packet_id, *filters):
    """Return a SUBSCRIBE of (filter, QoS) pairs."""
    return framed(
        0x82,
        packet_id.to_bytes(2, "big")
        + b"".join(text(filter_) + bytes([qos]) for filter_, qos in filters),
    )


class Receiver:
    """A connected client that collects the messages of its subscriptions while the block runs."""

    def __init__(self, client, *filters, qos=1):
        self.client, self.messages = client, []
        self._filters = [(filter_, qos) for filter_ in filters]
        self.publish, self.subscribe = client.publish, client.subscribe

    async def __aenter__(self):
        await self.client.__aenter__()
        self._task = asyncio.create_task(self._collect())
        if self._filters:
            await self.subscribe(self._filters)
        return self

    async def __aexit__(self, *error):
        self._task.cancel()
        with contextlib.suppress(asyncio.CancelledError, aiomqtt.MqttError):
            await self._task
        await self.client.__aexit__(*error)

    async def _collect(self):
        async for message in self.client.messages:
            self.messages.append(message)

    def payloads(self, topic):
        return [bytes(message.payload) for message in self.messages if str(message.topic) == topic]

    async def until_received(self, count):
        """Wait for this many messages."""
        async with asyncio.timeout(patient(SECONDS)):
            while len(self.messages) < count:
                await asyncio.sleep(0.005)

    async def payload(self, topic, payload):
        """Wait for a payload on a topic and return the message."""
        async with asyncio.timeout(patient(SECONDS)):
            while payload not in self.payloads(topic):
                await asyncio.sleep(0.005)
        return next(
            m for m in self.messages if str(m.topic) == topic and bytes(m.payload) == payload
        )
