"""One client of the embedded broker: bytes in, packets to the hub, in turns.

A turn is a few packets; then every other client has one, and until the next no bytes are read, so
that TCP makes a sender wait that is faster than its turns. A user that has had its allowance waits
as long as it takes to have earned more. Before the password was found right, the bytes of the
CONNECT are read and not one more, and the broker looks at one CONNECT a turn of its loop.
"""

import asyncio
import logging
import ssl
import time
from typing import Any, Protocol

from robots.broker import packets
from robots.broker.admission import Admission, Usage
from robots.broker.bounded_log import BoundedLog
from robots.broker.hub import Hub, MqttSession
from robots.broker.packets import (
    Acknowledgement,
    Connect,
    Disconnect,
    Packet,
    PingRequest,
    ProtocolError,
    PublishPacket,
    Subscribe,
    Unsubscribe,
)
from robots.broker.permissions import MAX_PACKET, BrokerUser

PACKETS_A_TURN = 8
READ_BYTES = 16 * 1024  # at once
COST_BYTES = 4 * 1024  # of a packet that cost as much as one more packet
CONNECT_SECONDS = 10.0  # from the connection to a right password
FLUSH_SECONDS = 5.0  # for the last bytes to a client that is sent away
SEND_BUFFER = 1024 * 1024
MAX_UNSENT = 3 * SEND_BUFFER  # answers to a client that takes none
CONNECT_BYTES = 8 * 1024  # of a CONNECT; ours has less than two KiB
KEEP_ALIVE_FACTOR = 1.5  # MQTT 3.1.1, section 3.1.2.10

# All connections read into it in turn: what was read is taken out before the next one reads.
_scratch = memoryview(bytearray(READ_BYTES))


class Desk(Protocol):
    """The broker, as its connections know it."""

    hub: Hub
    log: BoundedLog
    admission: "Admission[ClientConnection]"
    connections: "set[ClientConnection]"

    def check(self, connection: "ClientConnection") -> None:
        """Have `connection.sign_in` run when its turn has come."""

    async def authenticate(self, connect: Connect, address: str) -> BrokerUser | None:
        """Return whose password it is, or None."""


class ClientConnection(asyncio.BufferedProtocol):
    """One client. Before its CONNECT was accepted `session` is None and nothing but the CONNECT
    counts.
    """

    transport: asyncio.Transport

    def __init__(self, desk: Desk, tls: ssl.SSLContext | None) -> None:
        self._desk, self._tls = desk, tls
        self.address = "?"
        self.session: MqttSession | None = None
        self.is_ready = True
        self.closing_since: float | None = None
        self.turns = 0  # for tests and measurements
        self._keep_alive = 0.0
        self._began = self._heard = time.monotonic()
        self._reader = packets.PacketReader(CONNECT_BYTES)
        self._usage: Usage[ClientConnection] | None = None
        self._next_turn: asyncio.Handle | None = None
        self._task: asyncio.Task[None] | None = None  # of a stranger: TLS, then the password

    # --- asyncio's side ---------------------------------------------------------------------------

    def connection_made(self, transport: Any) -> None:
        """Count the stranger before anything is read, and speak TLS with it."""
        self.transport = transport
        peer = transport.get_extra_info("peername")
        self.address = str(peer[0]) if peer else "?"
        self._desk.connections.add(self)
        displaced = self._desk.admission.arrive(self, self.address)
        if displaced is not None:
            self._note(logging.WARNING, "broker_strangers_full", displaced=displaced.address)
            displaced.kick()
        if self._tls is None:
            transport.set_write_buffer_limits(high=SEND_BUFFER)
        else:
            # Where the server listens with TLS, asyncio shows a connection only after the
            # handshake: strangers could hold any number.
            transport.pause_reading()
            self._task = asyncio.get_running_loop().create_task(self._secure(self._tls))

    def connection_lost(self, error: Exception | None) -> None:
        """Tell the hub, and free the place. One that ends in the handshake of TLS is told so by
        asyncio sometimes, and by `_secure`.
        """
        if self not in self._desk.connections:
            return
        self.closing_since = self.closing_since or time.monotonic()
        self._desk.connections.discard(self)
        self._desk.admission.leave(self)
        for waiting in (self._task, self._next_turn):
            if waiting is not None:
                waiting.cancel()
        self._task = self._next_turn = None  # a task that was cancelled keeps its frame, and us
        if self.session is not None:
            self._desk.hub.leave(self.session, self, graceful=False, now=time.monotonic())
        # asyncio's TLS keeps our methods, and 256 KiB beside them: in a circle with us those would
        # wait for the collector, in a flood by the hundred.
        del self.transport

    def pause_writing(self) -> None:
        """Be too slow for more."""
        self.is_ready = False

    def resume_writing(self) -> None:
        """Take what has waited."""
        self.is_ready = True
        if self.session is not None:
            self._desk.hub.push(self.session)

    def get_buffer(self, sizehint: int) -> memoryview:
        """Return where to read to: of a stranger no more than its CONNECT."""
        if self.session is not None:
            return _scratch
        return _scratch[: max(1, min(self._reader.missing, READ_BYTES))]

    def buffer_updated(self, nbytes: int) -> None:
        """Take what was read."""
        self._heard = time.monotonic()
        self._reader.add(_scratch[:nbytes])
        if self.closing_since is None and self._next_turn is None:
            self._turn()

    # --- the hub's side ---------------------------------------------------------------------------

    def write(self, data: bytes) -> None:
        """Send bytes; a client that asks and asks and never takes its answers is sent away."""
        if self.transport.is_closing():  # asyncio would write a line into the log for each
            return
        self.transport.write(data)
        if self.transport.get_write_buffer_size() > MAX_UNSENT:
            self._note(
                logging.WARNING, "broker_answers_not_taken", address=self.address, user=self.user
            )
            self.kick()

    def kick(self) -> None:
        """Close at once."""
        self.closing_since = time.monotonic()
        self.transport.abort()

    # --- strangers --------------------------------------------------------------------------------

    async def _secure(self, tls: ssl.SSLContext) -> None:
        secured = None
        try:
            secured = await asyncio.get_running_loop().start_tls(
                self.transport,
                self,
                tls,
                server_side=True,
                ssl_handshake_timeout=CONNECT_SECONDS,
                ssl_shutdown_timeout=FLUSH_SECONDS,
            )
        except OSError as error:
            # a circle of asyncio's: the future in its frame has the exception, whose traceback has
            # the frame
            error.with_traceback(None)
        self._task = None
        if secured is None:  # asyncio tells nobody else of a connection that ends in its handshake
            self.connection_lost(None)
            return
        self.transport = secured
        secured.set_write_buffer_limits(high=SEND_BUFFER)

    def _await_password(self) -> None:
        """Have the password looked at, once all of the CONNECT is here."""
        if self._reader.size:
            self.transport.pause_reading()
            self._desk.admission.progress(self)
            self._desk.check(self)

    def sign_in(self) -> None:
        """Look at the CONNECT, and at its password."""
        try:
            connect = self._reader.take()
        except packets.UnsupportedVersionError as error:
            self._note(
                logging.WARNING, "broker_version_refused", address=self.address, reason=str(error)
            )
            self._send_away(packets.BAD_VERSION)
            return
        if not isinstance(connect, Connect):
            raise ProtocolError("first packet is not CONNECT")
        self._task = asyncio.get_running_loop().create_task(self._accept(connect))

    async def _accept(self, connect: Connect) -> None:
        user = await self._desk.authenticate(connect, self.address)
        self._task = None  # from here on nothing waits
        if user is None:
            self._send_away(
                packets.BAD_PASSWORD if connect.password is not None else packets.NOT_AUTHORIZED
            )
            return
        now = time.monotonic()
        is_in, displaced = self._desk.admission.sign_in(self, user, now)
        if displaced is not None:
            self._note(logging.WARNING, "broker_connections_of_user_full", user=user.name)
            displaced.kick()
        if not is_in:
            self._note(
                logging.WARNING, "broker_connection_refused", user=user.name, address=self.address
            )
            self._send_away(packets.UNAVAILABLE)
            return
        self.session, code, present = self._desk.hub.connect(connect, user, self, now)
        if self.session is None:
            self._send_away(code)
            return
        self._usage = self._desk.admission.usage(user, now)
        self._reader.limit = MAX_PACKET
        self._keep_alive = connect.keep_alive * KEEP_ALIVE_FACTOR
        self._heard = now
        self._note(
            logging.INFO,
            "broker_connected",
            user=user.name,
            client=connect.client_id[:80],
            address=self.address,
        )
        self.write(packets.connack(code, session_present=present))
        self._desk.hub.resume(self.session)
        self.transport.resume_reading()

    # --- turns ------------------------------------------------------------------------------------

    def _turn(self) -> None:
        self._next_turn = None
        try:
            if self.session is None or self._usage is None:
                self._await_password()
                return
            wait = self._take_turn(self.session, self._usage)
            is_more = self.closing_since is None and self._reader.size > 0
        except ProtocolError as error:
            self.break_off(error)
            return
        if is_more:
            self.transport.pause_reading()
            loop = asyncio.get_running_loop()
            self._next_turn = (
                loop.call_later(wait, self._turn) if wait else loop.call_soon(self._turn)
            )
        elif self.closing_since is None:
            self.transport.resume_reading()

    def _take_turn(self, session: MqttSession, usage: Usage["ClientConnection"]) -> float:
        """Obey a few packets; return how long this user has to wait for more."""
        self.turns += 1
        for _ in range(PACKETS_A_TURN):
            now = time.monotonic()
            self._heard = now
            wait = usage.bucket.wait(now, PACKETS_A_TURN)
            if wait or not (size := self._reader.size) or self.closing_since is not None:
                return wait
            packet = self._reader.take()
            usage.bucket.take(
                1
                + size // COST_BYTES
                + (len(packet.filters) if isinstance(packet, Subscribe) else 0),
                now,
            )
            self._obey(session, packet)
        return 0.0

    def _obey(self, session: MqttSession, packet: Packet) -> None:
        hub = self._desk.hub
        match packet:
            case PublishPacket():
                self._published(session, packet)
            case Acknowledgement():
                self._acknowledged(session, packet)
            case Subscribe():
                codes = hub.subscribe(session, packet)
                self.write(packets.suback(packet.packet_id, codes))
                hub.send_retained(session, packet, codes)
            case Unsubscribe():
                hub.unsubscribe(session, packet.filters)
                self.write(packets.unsuback(packet.packet_id))
            case PingRequest():
                self.write(packets.PINGRESP_PACKET)
            case Disconnect():
                hub.leave(session, self, graceful=True, now=time.monotonic())
                self._close()
            case Connect():
                raise ProtocolError("second CONNECT")

    def _published(self, session: MqttSession, message: PublishPacket) -> None:
        if message.qos == 2:
            self._desk.hub.receive_once(session, message)
            self.write(packets.acknowledgement(packets.PUBREC, message.packet_id))
            return
        self._desk.hub.publish(session, message)
        if message.qos:
            self.write(packets.acknowledgement(packets.PUBACK, message.packet_id))

    def _acknowledged(self, session: MqttSession, packet: Acknowledgement) -> None:
        if packet.kind == packets.PUBACK:
            self._desk.hub.acknowledge(session, packet.packet_id)
        elif packet.kind == packets.PUBREL:
            session.received.discard(packet.packet_id)
            self.write(packets.acknowledgement(packets.PUBCOMP, packet.packet_id))

    # --- endings ----------------------------------------------------------------------------------

    @property
    def user(self) -> str:
        """The name of whoever this is, as far as it is known."""
        return self.session.user.name if self.session is not None else "?"

    def break_off(self, error: ProtocolError) -> None:
        """End a connection that has no meaning any more."""
        self._note(
            logging.WARNING,
            "broker_protocol_error",
            address=self.address,
            user=self.user,
            reason=str(error),
        )
        self.kick()

    def sweep(self, now: float) -> None:
        """End what has lasted too long: a silent client, one that never said who it is, one that
        does not take its last bytes.
        """
        silent = (
            self.session is not None
            and self._keep_alive
            and self._next_turn is None
            and now - self._heard > self._keep_alive
        )
        nameless = self.session is None and now - self._began > CONNECT_SECONDS
        stuck = self.closing_since is not None and now - self.closing_since > FLUSH_SECONDS
        if silent or nameless or stuck:
            self._note(
                logging.INFO,
                "broker_gave_up",
                address=self.address,
                user=self.user,
                silent=bool(silent),
            )
            self.kick()

    def _send_away(self, code: int) -> None:
        self.write(packets.connack(code))
        self._close()

    def _close(self) -> None:
        self.closing_since = time.monotonic()
        self.transport.close()

    def _note(self, level: int, event: str, **fields: object) -> None:
        self._desk.log.write(
            level, self.user if self.session is not None else self.address, event, **fields
        )
