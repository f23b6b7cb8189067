"""The agent's one connection to the broker, which reconnects without end.

The agent only connects out, over TCP, TLS or WebSocket. On each connection it publishes ONLINE and
its factsheet (a restarted broker has lost them) and leaves a will, CONNECTIONBROKEN. It subscribes
to its own presence: the will of a connection that died half open arrives seconds after the next one
is up, and is then answered with ONLINE.
"""

import asyncio
import contextlib
import random
import re
import secrets
import ssl
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, Protocol
from urllib.parse import unquote, urlsplit

import structlog
from aiomqtt import Client, Message as Delivery, MqttError, Will
from paho.mqtt.reasoncodes import ReasonCode

from robots.agent.broker_link.broker_discovery import tls_context
from robots.agent.broker_link.outbox import OutboundMessage, Outbox, outbound
from robots.agent.broker_link.reconnection import Reconnection
from robots.api import codec, topics
from robots.api.errors import Rejection
from robots.api.messages import Connection, Factsheet
from robots.process.logs import reason_of

log = structlog.stdlib.get_logger(__name__)

# s; of a broker with several nodes, another one is soon found
KEEPALIVE, KEEPALIVE_OF_NODES = 5, 2
TIMEOUT = 5.0
FAREWELL = 2.0
IN_FLIGHT = 20
INCOMING = 5000
REFUSALS = {134, 135}  # MQTT 5's reason codes: bad user name or password, not authorized
TAKES_OVER = 5.0  # s that a site may need until its broker accepts a new password
SUBSCRIPTION_REFUSED = 0x80
PORTS = {"mqtt": 1883, "mqtts": 8883, "ws": 80, "wss": 443}


class LinkInbox(Protocol):
    """Receives the link's messages and events. Called on the link's loop; must not block."""

    def arrived(self, suffix: str, message: Any, *, retained: bool) -> None:
        """Take a message; None for an empty one, which deletes a retained message."""

    def rejected(self, reason: str) -> None:
        """Count a message that could not be decoded."""

    def link_changed(self, *, up: bool) -> None:
        """The broker was reached, or lost."""

    def rival(self, boot: str | None) -> None:
        """Another agent claims to be this robot (its boot), or has stopped (None)."""

    def is_needed(self) -> bool:
        """Whether the robot is in use: a lost connection is then retried at once."""


@dataclass(frozen=True)
class Endpoint:
    """The broker's address and our credentials."""

    host: str
    port: int
    transport: Literal["tcp", "websockets"]
    tls: ssl.SSLContext | None
    path: str | None
    username: str | None = None
    password: str | None = None

    @classmethod
    def of(
        cls,
        url: str,
        username: str | None = None,
        password: str | None = None,
        ca: str | None = None,
    ) -> "Endpoint":
        """Read `mqtt://`, `mqtts://`, `ws://` or `wss://host:port/path`; `ca` is a file of
        certificates to trust besides the system's. Raises ValueError for another address or an
        unreadable file.
        """
        if fault := _fault_in(url):
            without_password = re.sub(r"//.*@", "//…@", url)
            raise ValueError(
                "the broker's address must be mqtt://, mqtts://, ws:// or wss://host:port, not"
                f" {without_password!r}: {fault}"
            )
        parts = urlsplit(url)
        web = parts.scheme in {"ws", "wss"}
        return cls(
            host=str(parts.hostname),
            port=parts.port or PORTS[parts.scheme],
            transport="websockets" if web else "tcp",
            tls=tls_context(ca) if parts.scheme in {"mqtts", "wss"} else None,
            path=(parts.path or "/mqtt") if web else None,
            username=username or (unquote(parts.username) if parts.username else None),
            password=password or (unquote(parts.password) if parts.password else None),
        )

    def client(self, **options: Any) -> Client:
        """Return a client with a clean session; `options` are more of its arguments."""
        return Client(
            self.host,
            self.port,
            username=self.username,
            password=self.password,
            transport=self.transport,
            websocket_path=self.path,
            tls_context=self.tls,
            clean_session=True,
            **options,
        )


def _fault_in(url: str) -> str:
    try:
        parts = urlsplit(url)
    except ValueError as error:
        return str(error)
    if parts.scheme not in PORTS:
        return "it begins with none of these"
    if not parts.hostname:
        return "it names no host"
    if len(url.split()) != 1:
        return "it contains blanks"
    try:  # the port may be a password's part behind a slash that was not written as %2F
        return "the port must be from 1 to 65535" if parts.port == 0 else ""
    except ValueError:
        return "the port must be from 1 to 65535"


async def subscribe(client: Client, filters: Sequence[str]) -> None:
    """Subscribe to filters at QoS 0.

    Raises:
        MqttError: there is no connection, or the broker refused one, which aiomqtt ignores.
    """
    granted = await client.subscribe([(filter_, 0) for filter_ in filters])
    codes = [code.value if isinstance(code, ReasonCode) else code for code in granted]
    refused = [
        name for name, code in zip(filters, codes, strict=True) if code >= SUBSCRIPTION_REFUSED
    ]
    if refused:
        raise MqttError(f"the broker does not allow this robot to read {', '.join(refused)}")


class MqttLink:
    """Reconnects without end, queues records in its outbox, and passes messages to an inbox.

    Args:
        endpoint: the broker. `others` are the same broker by other transports, or other nodes of
            it, tried in turn when one cannot be reached.
        factsheet: identifies this robot; published on each connection.
        rng: spreads the attempts of many robots.
    """

    def __init__(
        self,
        endpoint: Endpoint,
        factsheet: Factsheet,
        *,
        rng: random.Random,
        unix: Callable[[], float] = time.time,
        others: tuple[Endpoint, ...] = (),
    ) -> None:
        self.connected = False
        self.outbox = Outbox()
        self._endpoints, self._factsheet, self._unix = (endpoint, *others), factsheet, unix
        self._reconnection = Reconnection(rng)
        self._wake, self._closing = asyncio.Event(), asyncio.Event()
        self._rival: str | None = None
        self._refused_since: float | None = None  # by the monotonic clock
        # secret: with Mosquitto, a client that knows an id can take its connection over
        self._client_id = f"{factsheet.name[:40]}-{secrets.token_hex(8)}"

    def credentials_changed(self, username: str, password: str) -> None:
        """Use other credentials from the next connection on; from any thread."""
        self._endpoints = tuple(
            replace(endpoint, username=username, password=password) for endpoint in self._endpoints
        )

    def publish(self, suffix: str, payload: bytes) -> None:
        """Send now, or a record also when the broker is reached again."""
        self.outbox.put(outbound(suffix, payload), connected=self.connected)
        self._wake.set()

    async def run(self, inbox: LinkInbox) -> None:
        while not self._closing.is_set():
            began = time.monotonic()
            try:
                await self._connection(inbox)
            except* (MqttError, OSError) as errors:
                place = {"host": self._endpoint.host, "port": self._endpoint.port}
                reasons = "; ".join(sorted({self._reason(error) for error in _leaves(errors)}))
                log.warning("broker_unreachable", **place, reason=reasons)
            was_connected, self.connected = self.connected, False
            held = time.monotonic() - began if was_connected else 0.0
            if inbox.is_needed():
                self._reconnection.needed(time.monotonic())
            if not was_connected or self._has_nodes:
                self._endpoints = (*self._endpoints[1:], self._endpoints[0])
            self.outbox.disconnected()
            if was_connected:
                inbox.link_changed(up=False)
            pause = self._reconnection.pause(held, time.monotonic())
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(pause):
                    await self._closing.wait()

    @property
    def _endpoint(self) -> Endpoint:
        return self._endpoints[0]

    @property
    def _has_nodes(self) -> bool:
        """Whether the endpoints are several machines: a lost connection may mean a dead one."""
        return len({endpoint.host for endpoint in self._endpoints}) > 1

    def close(self) -> None:
        """Send the rest, then OFFLINE; `run` returns, or is to be cancelled after FAREWELL s."""
        self._closing.set()
        self._wake.set()

    # --- one connection ---------------------------------------------------------------------------

    async def _connection(self, inbox: LinkInbox) -> None:
        async with self._client() as client:
            client.pending_calls_threshold = 10 * IN_FLIGHT
            async with asyncio.TaskGroup() as tasks:
                receiving = tasks.create_task(self._receive(client, inbox))
                await self._greet(client)
                self.connected = True
                log.info("broker_connected", host=self._endpoint.host, port=self._endpoint.port)
                inbox.link_changed(up=True)
                self._refused_since = None
                await self._send(client, tasks)
                topic, state = self._topic("connection"), self._presence("OFFLINE")
                await client.publish(topic, state, qos=1, retain=True, timeout=FAREWELL)
                receiving.cancel()

    def _client(self) -> Client:
        broken = self._presence("CONNECTIONBROKEN")
        return self._endpoint.client(
            identifier=self._client_id,
            keepalive=KEEPALIVE_OF_NODES if self._has_nodes else KEEPALIVE,
            timeout=TIMEOUT,
            will=Will(self._topic("connection"), broken, qos=1, retain=True),
            max_queued_incoming_messages=INCOMING,
        )

    async def _greet(self, client: Client) -> None:
        await subscribe(client, topics.subscriptions(self._factsheet.name))
        for suffix, payload in (
            ("factsheet", codec.encode(self._factsheet)),
            ("connection", self._presence("ONLINE")),
        ):
            await client.publish(self._topic(suffix), payload, qos=1, retain=True)

    async def _send(self, client: Client, tasks: asyncio.TaskGroup) -> None:
        """Send the outbox in order, IN_FLIGHT at a time, until closed and acknowledged."""
        while not (
            self._closing.is_set() and not len(self.outbox) and not self.outbox.unacknowledged
        ):
            while len(self.outbox) and self.outbox.unacknowledged < IN_FLIGHT:
                tasks.create_task(self._deliver(client, self.outbox.take()))
            self._wake.clear()
            await self._wake.wait()

    async def _deliver(self, client: Client, message: OutboundMessage) -> None:
        await client.publish(
            self._topic(message.suffix), message.payload, qos=message.qos, retain=message.retained
        )
        self.outbox.acknowledged(message)
        self._wake.set()

    async def _receive(self, client: Client, inbox: LinkInbox) -> None:
        async for delivery in client.messages:
            self._take(delivery, inbox)

    def _take(self, delivery: Delivery, inbox: LinkInbox) -> None:
        parsed = topics.parse(str(delivery.topic))
        payload = delivery.payload if isinstance(delivery.payload, bytes) else b""
        if parsed is None:
            inbox.rejected("unknown_topic")
            return
        suffix = parsed[1]
        try:
            if suffix != "connection":
                message = codec.decode(suffix, payload, "to_robot") if payload else None
                inbox.arrived(suffix, message, retained=bool(delivery.retain))
                return
            presence = codec.decode(suffix, payload)
            if not delivery.retain and not self._closing.is_set():
                self._watch_presence(presence, inbox)
        except Rejection as rejection:
            reason, detail = rejection.reason, rejection.detail[:200]
            log.warning("message_rejected", suffix=suffix[:80], reason=reason, detail=detail)
            inbox.rejected(reason)

    def _watch_presence(self, presence: Connection, inbox: LinkInbox) -> None:
        """Answer a late will, and detect another agent that claims to be this robot.

        Boots sort by the time of their start, so of two agents only the older one finds a rival and
        yields.
        """
        own = self._factsheet.boot
        if presence.state == "ONLINE" and presence.boot > own and presence.boot != self._rival:
            self._rival = presence.boot
            inbox.rival(presence.boot)
        elif presence.state != "ONLINE" or presence.boot < own:
            self.publish("connection", self._presence("ONLINE"))
            if presence.boot == self._rival:
                self._rival = None
                inbox.rival(None)

    def _reason(self, error: BaseException) -> str:
        """Return why there is no connection, and what the owner can do about it."""
        if getattr(getattr(error, "rc", None), "value", None) not in REFUSALS:
            return reason_of(error)
        now = time.monotonic()
        self._refused_since = self._refused_since or now
        if now - self._refused_since < TAKES_OVER:
            return "the site does not accept this robot's password yet"
        # no colon after "password": logs redact the text after one
        return (
            "the site does not accept this robot's password. On the site's machine run"
            f" `manage.py enrol {self._factsheet.name} --server https://ADDRESS-OF-THE-SITE`, then"
            " here the command that it prints"
        )

    def _topic(self, suffix: str) -> str:
        return topics.of(self._factsheet.name, suffix)

    def _presence(self, state: Literal["ONLINE", "OFFLINE", "CONNECTIONBROKEN"]) -> bytes:
        return codec.encode(Connection(boot=self._factsheet.boot, state=state, stamp=self._unix()))


def _leaves(group: BaseExceptionGroup[Any]) -> list[BaseException]:
    found: list[BaseException] = []
    for error in group.exceptions:
        found += _leaves(error) if isinstance(error, BaseExceptionGroup) else [error]
    return found
