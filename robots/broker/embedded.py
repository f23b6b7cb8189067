"""The embedded broker: sockets, clock and passwords around `Hub`. It needs nothing but Python, and runs in a process of its own.

Each connection is an asyncio protocol that reads packets, asks the hub, and writes. Passwords are checked off the loop; users come
from memory, which a task renews from the database, so that no message waits for a query.
"""

import asyncio
import logging
import ssl
import time
from collections import Counter
from collections.abc import Awaitable, Callable
from typing import Any

from accounts.client_address import counted
from robots.broker import packets
from robots.broker.hub import Hub, Session
from robots.broker.packets import Acknowledgement, Connect, Disconnect, Packet, PingRequest, ProtocolError, Publish, Subscribe, Unsubscribe
from robots.broker.permissions import BrokerUser
from robots.broker.users import MAX_PACKET, POLL_SECONDS, SESSION_SECONDS, ReadUsers, UsersUnavailableError
from robots.credentials import Verifier, matches

logger = logging.getLogger(__name__)

CONNECT_SECONDS = 10.0  # from the connection to a right password
FLUSH_SECONDS = 5.0  # for the last bytes to a client that is sent away
SWEEP_SECONDS = 0.5
REFRESH_SECONDS = 0.5  # least time between two extra looks at the database
SEND_BUFFER = 1024 * 1024
MAX_CONNECTIONS = 2_000
MAX_STRANGERS = 50  # connections from one address that have not yet said who they are, so that it cannot take every place
CONNECT_BYTES = 64 * 1024  # of a packet before its sender is let in; a CONNECT of ours has less than two KiB
KEEP_ALIVE_FACTOR = 1.5  # MQTT 3.1.1, section 3.1.2.10

Authenticate = Callable[[Connect, str], Awaitable[BrokerUser | None]]


class _Connection(asyncio.Protocol):
    """One client. Before its CONNECT was accepted `session` is None and nothing but the CONNECT counts."""

    def __init__(self, hub: Hub, authenticate: Authenticate, connections: "set[_Connection]", strangers: Counter[str]) -> None:
        self.hub, self.authenticate, self.connections, self.strangers = hub, authenticate, connections, strangers
        self.address = self.household = "?"
        self.is_stranger = False
        self.session: Session | None = None
        self.is_ready = True
        self.keep_alive = 0.0
        self.began = self.heard = time.monotonic()
        self.closing_since: float | None = None
        self._reader = packets.PacketReader(CONNECT_BYTES)
        self._early: list[Packet] = []  # what came in one piece with the CONNECT
        self._check: asyncio.Task[None] | None = None

    # --- asyncio's side -----------------------------------------------------------------------------------------------

    def connection_made(self, transport: Any) -> None:
        self.transport: asyncio.Transport = transport
        transport.set_write_buffer_limits(high=SEND_BUFFER)
        peer = transport.get_extra_info("peername")  # with TLS nobody knows it any more when the connection is lost
        self.address = str(peer[0]) if peer else "?"
        self.household = counted(self.address)
        if len(self.connections) >= MAX_CONNECTIONS:
            logger.error("broker_connections_full")
            transport.abort()
            return
        if self.strangers[self.household] >= MAX_STRANGERS:
            logger.warning("broker_strangers_refused address=%s", self.address)
            transport.abort()
            return
        self.is_stranger = True
        self.strangers[self.household] += 1
        self.connections.add(self)

    def connection_lost(self, _error: Exception | None) -> None:
        self.connections.discard(self)
        self._no_longer_strange()
        if self._check is not None:
            self._check.cancel()
        if self.session is not None:
            self.hub.leave(self.session, self, graceful=False, now=time.monotonic())

    def _no_longer_strange(self) -> None:
        if self.is_stranger:
            self.is_stranger = False
            self.strangers[self.household] -= 1
            if not self.strangers[self.household]:
                del self.strangers[self.household]

    def pause_writing(self) -> None:
        self.is_ready = False

    def resume_writing(self) -> None:
        self.is_ready = True
        if self.session is not None:
            self.hub.push(self.session)

    def data_received(self, data: bytes) -> None:
        self.heard = time.monotonic()
        try:
            for packet in self._reader.feed(data):
                if self.closing_since is not None:
                    return
                self._take(packet)
        except packets.UnsupportedVersionError as error:
            logger.warning("broker_version_refused address=%s reason=%s", self.address, error)
            self._send_away(packets.BAD_VERSION)
        except ProtocolError as error:
            logger.warning("broker_protocol_error address=%s user=%s reason=%s", self.address, self.user, error)
            self.kick()

    # --- the hub's side -----------------------------------------------------------------------------------------------

    def write(self, data: bytes) -> None:
        self.transport.write(data)

    def kick(self) -> None:
        self.closing_since = time.monotonic()
        self.transport.abort()

    # --- packets ------------------------------------------------------------------------------------------------------

    @property
    def user(self) -> str:
        return self.session.user.name if self.session is not None else "?"

    def _take(self, packet: Packet) -> None:
        if self.session is not None:
            self._obey(self.session, packet)
        elif self._check is not None:
            self._early.append(packet)
        elif isinstance(packet, Connect):
            self.transport.pause_reading()
            self._check = asyncio.get_running_loop().create_task(self._accept(packet))
        else:
            raise ProtocolError("first packet is not CONNECT")

    async def _accept(self, connect: Connect) -> None:
        user = await self.authenticate(connect, self.address)
        if user is None:
            self._send_away(packets.BAD_PASSWORD if connect.password is not None else packets.NOT_AUTHORIZED)
            return
        self.session, code, present = self.hub.connect(connect, user, self, time.monotonic())
        if self.session is None:
            self._send_away(code)
            return
        self._no_longer_strange()
        self._reader.limit = MAX_PACKET
        self.keep_alive = connect.keep_alive * KEEP_ALIVE_FACTOR
        self.heard = time.monotonic()
        logger.info("broker_connected user=%s client=%.80r address=%s", user.name, connect.client_id, self.address)
        self.write(packets.connack(code, session_present=present))
        self.hub.resume(self.session)
        self._take_early()
        self.transport.resume_reading()

    def _take_early(self) -> None:
        try:
            for packet in self._early:
                self._take(packet)
        except ProtocolError as error:
            logger.warning("broker_protocol_error address=%s user=%s reason=%s", self.address, self.user, error)
            self.kick()
        self._early.clear()

    def _obey(self, session: Session, packet: Packet) -> None:
        match packet:
            case Publish():
                self._published(session, packet)
            case Acknowledgement():
                self._acknowledged(session, packet)
            case Subscribe():
                codes = self.hub.subscribe(session, packet)
                self.write(packets.suback(packet.packet_id, codes))
                self.hub.send_retained(session, packet, codes)
            case Unsubscribe():
                self.hub.unsubscribe(session, packet.filters)
                self.write(packets.unsuback(packet.packet_id))
            case PingRequest():
                self.write(packets.PINGRESP_PACKET)
            case Disconnect():
                self.hub.leave(session, self, graceful=True, now=time.monotonic())
                self._close()
            case Connect():
                raise ProtocolError("second CONNECT")

    def _published(self, session: Session, message: Publish) -> None:
        if message.qos < 2 or message.packet_id not in session.received:  # noqa: PLR2004 -- exactly once
            self.hub.publish(session, message)
        if message.qos == 1:
            self.write(packets.acknowledgement(packets.PUBACK, message.packet_id))
        elif message.qos:
            session.received.add(message.packet_id)
            self.write(packets.acknowledgement(packets.PUBREC, message.packet_id))

    def _acknowledged(self, session: Session, packet: Acknowledgement) -> None:
        if packet.kind == packets.PUBACK:
            self.hub.acknowledge(session, packet.packet_id)
        elif packet.kind == packets.PUBREL:
            session.received.discard(packet.packet_id)
            self.write(packets.acknowledgement(packets.PUBCOMP, packet.packet_id))

    # --- endings ------------------------------------------------------------------------------------------------------

    def _send_away(self, code: int) -> None:
        self.write(packets.connack(code))
        self._close()

    def _close(self) -> None:
        self.closing_since = time.monotonic()
        self.transport.close()

    def sweep(self, now: float) -> None:
        """End what has lasted too long: a silent client, one that never said who it is, one that does not take its last bytes."""
        silent = self.session is not None and self.keep_alive and now - self.heard > self.keep_alive
        nameless = self.session is None and now - self.began > CONNECT_SECONDS
        stuck = self.closing_since is not None and now - self.closing_since > FLUSH_SECONDS
        if silent or nameless or stuck:
            logger.info("broker_gave_up address=%s user=%s silent=%s", self.address, self.user, bool(silent))
            self.kick()


class EmbeddedBroker:
    """A broker on one port. `read_users` is asked every `poll` seconds, and when somebody unknown or with a new key connects."""

    name = "embedded"

    def __init__(self, read_users: ReadUsers, *, poll: float = POLL_SECONDS) -> None:
        self.hub = Hub()
        self._read_users, self._poll = read_users, poll
        self._users: dict[str, BrokerUser] = {}
        self._read_at = -1e18
        self._reading = asyncio.Lock()
        self._verifier = Verifier()
        self._connections: set[_Connection] = set()
        self._strangers: Counter[str] = Counter()
        self._server: asyncio.Server | None = None
        self._tasks: list[asyncio.Task[None]] = []

    async def start(self, host: str, port: int, tls: ssl.SSLContext | None = None) -> int:
        """Listen and return the port (a free one when asked for 0).

        Raises:
            OSError: the address cannot be had.
            UsersUnavailableError: the database cannot be read.
        """
        self._take_users(await self._read_users())
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(
            lambda: _Connection(self.hub, self._authenticate, self._connections, self._strangers), host, port, ssl=tls, reuse_address=True
        )
        self._tasks = [loop.create_task(self._sweep()), loop.create_task(self._follow_users())]
        return int(self._server.sockets[0].getsockname()[1])

    async def wait(self) -> None:
        """Return only with an exception: when one of the broker's own tasks has failed."""
        await asyncio.gather(*self._tasks)

    async def stop(self) -> None:
        """Close every connection, and the port."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        if self._server is not None:
            self._server.close()
        for connection in list(self._connections):
            connection.kick()
        if self._server is not None:
            await self._server.wait_closed()

    async def _sweep(self) -> None:
        while True:
            await asyncio.sleep(SWEEP_SECONDS)
            now = time.monotonic()
            for connection in list(self._connections):
                connection.sweep(now)
            self.hub.expire(now - SESSION_SECONDS)

    async def _follow_users(self) -> None:
        while True:
            await asyncio.sleep(self._poll)
            await self._refresh()

    async def _refresh(self) -> None:
        """See to it that the users are read after this moment, at most every REFRESH_SECONDS; what cannot be read changes nothing."""
        asked = time.monotonic()
        async with self._reading:
            if self._read_at > asked:  # somebody else's look came after ours was asked for
                return
            await asyncio.sleep(self._read_at + min(REFRESH_SECONDS, self._poll) - time.monotonic())
            begun = time.monotonic()
            try:
                self._take_users(await self._read_users())
            except UsersUnavailableError as error:
                logger.warning("broker_users_unavailable reason=%s", error)
            self._read_at = begun

    def _take_users(self, users: dict[str, BrokerUser]) -> None:
        self._users = users
        self.hub.set_users(users, time.monotonic())

    async def _authenticate(self, connect: Connect, address: str) -> BrokerUser | None:
        name, token = connect.user, connect.password
        if name is None or token is None:
            logger.warning("broker_anonymous_refused address=%s", address)
            return None
        known = self._users.get(name)
        if known is not None and self._verifier.knows(token, known.credential_hash, time.monotonic()):
            return known
        if self._verifier.is_blocked(counted(address), name, time.monotonic()):
            logger.warning("broker_blocked user=%.80r address=%s", name, address)
            return None
        user = await self._verified(name, token)
        if user is None:
            await self._refresh()  # perhaps the key is younger than our last look at the database
            user = await self._verified(name, token)
        if user is None:
            self._verifier.note_failure(counted(address), name, time.monotonic())
            logger.warning("broker_password_refused user=%.80r address=%s", name, address)
        return user

    async def _verified(self, name: str, token: str) -> BrokerUser | None:
        user = self._users.get(name)
        if user is None or not await asyncio.to_thread(matches, token, user.credential_hash):
            return None
        self._verifier.note(token, user.credential_hash, time.monotonic())
        return user if self._users.get(name) == user else None  # it may have been revoked meanwhile
