"""Bytes to MQTT 3.1.1 control packets and back; no I/O (OASIS MQTT 3.1.1, chapters 2 and 3).

`PacketReader` takes bytes as they come and returns whole packets. It refuses an oversized packet as
soon as its length is known, before a byte of it is stored; after a `ProtocolError` the connection
has no meaning any more and must be closed.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from msgspec import Struct

from robots.broker.filters import is_topic

CONNECT, CONNACK, PUBLISH, PUBACK, PUBREC, PUBREL, PUBCOMP = 1, 2, 3, 4, 5, 6, 7
SUBSCRIBE, SUBACK, UNSUBSCRIBE, UNSUBACK, PINGREQ, PINGRESP, DISCONNECT = 8, 9, 10, 11, 12, 13, 14

ACCEPTED, BAD_VERSION, BAD_CLIENT_ID, UNAVAILABLE, BAD_PASSWORD, NOT_AUTHORIZED = 0, 1, 2, 3, 4, 5
SUBSCRIPTION_REFUSED = 0x80
LEVEL = 4  # MQTT 3.1.1
_LONGEST_LENGTH = 4  # bytes of the remaining length
_SHORTEST_CONNECT = 14  # bytes: fixed header, "MQTT", level, flags, keep-alive, an empty client id
MAX_FILTERS = 64  # of one SUBSCRIBE or UNSUBSCRIBE; a robot has fifteen
_MORE, _DUP, _RETAIN = 0x80, 0x08, 0x01
_USERNAME, _PASSWORD, _WILL_RETAIN, _WILL, _CLEAN, _RESERVED = 0x80, 0x40, 0x20, 0x04, 0x02, 0x01
# The fixed flags that section 2.2.2 demands; PUBLISH has flags of its own.
_FLAGS = {PUBREL: 2, SUBSCRIBE: 2, UNSUBSCRIBE: 2}


class ProtocolError(Exception):
    """What came is not MQTT 3.1.1, or breaks a limit; the connection must be closed."""


class UnsupportedVersionError(ProtocolError):
    """Another version of MQTT, which may be told so in a CONNACK."""


class PublishPacket(Struct, frozen=True):
    """PUBLISH; `packet_id` is 0 at QoS 0. A Struct, because one is made for every message, several
    times faster than a dataclass.
    """

    topic: str
    payload: bytes
    qos: int = 0
    retain: bool = False
    packet_id: int = 0
    dup: bool = False


@dataclass(frozen=True)
class Connect:
    """CONNECT; `keep_alive` in seconds, 0 for none."""

    client_id: str
    clean: bool
    keep_alive: int
    user: str | None
    password: str | None
    will: PublishPacket | None


class Acknowledgement(Struct, frozen=True):
    """PUBACK, PUBREC, PUBREL or PUBCOMP, by `kind`."""

    kind: int
    packet_id: int


@dataclass(frozen=True)
class Subscribe:
    """SUBSCRIBE: (filter, QoS) pairs."""

    packet_id: int
    filters: tuple[tuple[str, int], ...]


@dataclass(frozen=True)
class Unsubscribe:
    """UNSUBSCRIBE."""

    packet_id: int
    filters: tuple[str, ...]


@dataclass(frozen=True)
class PingRequest:
    """PINGREQ."""


@dataclass(frozen=True)
class Disconnect:
    """DISCONNECT: a proper good-bye, the will is forgotten."""


Packet = (
    Connect | PublishPacket | Acknowledgement | Subscribe | Unsubscribe | PingRequest | Disconnect
)


class PacketReader:
    """Collects bytes until they make packets of at most `limit` bytes each, which may change."""

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self._buffer = bytearray()
        self._head: tuple[int, int] | None = None  # of the first packet, once its length has come

    def feed(self, data: bytes) -> Iterator[Packet]:
        """Take bytes and yield every packet that is whole now.

        Raises:
            ProtocolError: malformed or oversized; whole packets in front of it have been yielded.
        """
        self.add(data)
        while self.size:
            yield self.take()

    def add(self, data: bytes | memoryview) -> None:
        """Keep bytes, without looking at them."""
        self._buffer += data

    @property
    def size(self) -> int:
        """How many bytes the first packet has, 0 while it is not whole.

        Raises:
            ProtocolError: it is oversized, or its length is none.
        """
        if len(self._buffer) < 2:
            return 0
        self._head = self._head or self._header()
        return self._head[1] if self._head is not None and len(self._buffer) >= self._head[1] else 0

    @property
    def missing(self) -> int:
        """How many bytes may be read at least without reading past a CONNECT that comes first.

        Raises:
            ProtocolError: as above.
        """
        header = self._header()
        return (header[1] if header is not None else _SHORTEST_CONNECT) - len(self._buffer)

    def take(self) -> Packet:
        """Return the first packet, whose size is known.

        Raises:
            ProtocolError: it is malformed.
        """
        assert self._head is not None, "its size was asked for"
        (start, end), self._head = self._head, None
        first, body = self._buffer[0], bytes(self._buffer[start:end])
        del self._buffer[:end]
        return _packet(first >> 4, first & 0x0F, body)

    def _header(self) -> tuple[int, int] | None:
        """Return (start, end) of the first packet's body, or None while its length is not known."""
        length = 0
        for index in range(1, min(len(self._buffer), 1 + _LONGEST_LENGTH)):
            byte = self._buffer[index]
            length |= (byte & 0x7F) << (7 * (index - 1))
            if not byte & _MORE:
                if length + index + 1 > self.limit:
                    raise ProtocolError(f"packet of {length} bytes is too large")
                return index + 1, index + 1 + length
        if len(self._buffer) > _LONGEST_LENGTH:
            raise ProtocolError("bad length")
        return None


class _Body:
    """Reads the fields of one packet's body."""

    def __init__(self, data: bytes) -> None:
        self.data, self.at = data, 0

    def take(self, count: int) -> bytes:
        if self.at + count > len(self.data):
            raise ProtocolError("packet too short")
        self.at += count
        return self.data[self.at - count : self.at]

    def byte(self) -> int:
        return self.take(1)[0]

    def number(self) -> int:
        return int.from_bytes(self.take(2), "big")

    def blob(self) -> bytes:
        return self.take(self.number())

    def text(self) -> str:
        try:
            text = self.blob().decode()
        except UnicodeDecodeError as error:
            raise ProtocolError("text is not UTF-8") from error
        if "\0" in text:
            raise ProtocolError("text contains U+0000")
        return text

    def packet_id(self) -> int:
        number = self.number()
        if number == 0:
            raise ProtocolError("packet id 0")
        return number

    @property
    def is_empty(self) -> bool:
        return self.at == len(self.data)

    def end(self) -> None:
        if not self.is_empty:
            raise ProtocolError("packet too long")


def _packet(kind: int, flags: int, data: bytes) -> Packet:
    body = _Body(data)
    if kind == PUBLISH:
        return _publish(flags, body)
    if flags != _FLAGS.get(kind, 0):
        raise ProtocolError(f"wrong flags {flags} for packet type {kind}")
    packet = _other(kind, body)
    body.end()
    return packet


def _other(kind: int, body: _Body) -> Packet:
    match kind:
        case 1:
            return _connect(body)
        case 4 | 5 | 6 | 7:
            return Acknowledgement(kind, body.packet_id())
        case 8:
            return Subscribe(body.packet_id(), tuple(_subscriptions(body)))
        case 10:
            return Unsubscribe(body.packet_id(), tuple(_texts(body)))
        case 12:
            return PingRequest()
        case 14:
            return Disconnect()
    raise ProtocolError(f"unexpected packet type {kind}")


def _publish(flags: int, body: _Body) -> PublishPacket:
    qos = (flags >> 1) & 3
    if qos == 3:
        raise ProtocolError("QoS 3")
    topic = body.text()
    if not is_topic(topic):
        raise ProtocolError("not a topic")
    packet_id = body.packet_id() if qos else 0
    return PublishPacket(
        topic,
        body.take(len(body.data) - body.at),
        qos,
        bool(flags & _RETAIN),
        packet_id,
        bool(flags & _DUP),
    )


def _connect(body: _Body) -> Connect:
    name, level = body.text(), body.byte()
    if name not in {"MQTT", "MQIsdp"}:
        raise ProtocolError("not MQTT")
    if level != LEVEL or name != "MQTT":
        raise UnsupportedVersionError(f"unsupported MQTT protocol level {level}")
    flags, keep_alive, client_id = body.byte(), body.number(), body.text()
    if flags & _RESERVED or (flags & _PASSWORD and not flags & _USERNAME):
        raise ProtocolError("CONNECT flags")
    will = _will(flags, body)
    user = body.text() if flags & _USERNAME else None
    password = body.text() if flags & _PASSWORD else None
    return Connect(client_id, bool(flags & _CLEAN), keep_alive, user, password, will)


def _will(flags: int, body: _Body) -> PublishPacket | None:
    qos = (flags >> 3) & 3
    if not flags & _WILL:
        if qos or flags & _WILL_RETAIN:
            raise ProtocolError("will flags without a will")
        return None
    if qos == 3:
        raise ProtocolError("QoS 3")
    return PublishPacket(body.text(), body.blob(), qos, bool(flags & _WILL_RETAIN))


def _subscriptions(body: _Body) -> Iterator[tuple[str, int]]:
    for text in _texts(body):
        qos = body.byte()
        if qos > 2:
            raise ProtocolError(f"QoS {qos}")
        yield text, qos


def _texts(body: _Body) -> Iterator[str]:
    if body.is_empty:
        raise ProtocolError("no topic filter")
    for _ in range(MAX_FILTERS):
        yield body.text()
        if body.is_empty:
            return
    raise ProtocolError(f"more than {MAX_FILTERS} topic filters")


def framed(first: int, body: bytes) -> bytes:
    """Return a packet: its first byte, the length of the body seven bits a byte, the body."""
    header, length = bytearray([first]), len(body)
    while True:
        length, digit = length >> 7, length & 0x7F
        header.append(digit | (_MORE if length else 0))
        if not length:
            return bytes(header) + body


def publish(message: PublishPacket) -> bytes:
    """Return a PUBLISH."""
    topic = message.topic.encode()
    packet_id = message.packet_id.to_bytes(2, "big") if message.qos else b""
    flags = (message.qos << 1) | (_DUP if message.dup else 0) | (_RETAIN if message.retain else 0)
    return framed(
        (PUBLISH << 4) | flags,
        b"".join((len(topic).to_bytes(2, "big"), topic, packet_id, message.payload)),
    )


def connack(code: int, *, session_present: bool = False) -> bytes:
    """Return a CONNACK with one of the return codes above."""
    return framed(CONNACK << 4, bytes([session_present and code == ACCEPTED, code]))


def acknowledgement(kind: int, packet_id: int) -> bytes:
    """Return a PUBACK, PUBREC, PUBREL or PUBCOMP."""
    return framed((kind << 4) | _FLAGS.get(kind, 0), packet_id.to_bytes(2, "big"))


def suback(packet_id: int, codes: list[int]) -> bytes:
    """Return a SUBACK: the granted QoS or SUBSCRIPTION_REFUSED for each filter."""
    return framed(SUBACK << 4, packet_id.to_bytes(2, "big") + bytes(codes))


def unsuback(packet_id: int) -> bytes:
    """Return an UNSUBACK."""
    return framed(UNSUBACK << 4, packet_id.to_bytes(2, "big"))


PINGRESP_PACKET = framed(PINGRESP << 4, b"")
