"""The client's side of MQTT 3.1.1 in as few steps as it takes: a client library would cost more
than the broker that it loads.

QoS 0 and 1 both ways, a will, keep-alive. What the broker sends is handed on as it is read; the
caller's handlers must not raise.
"""

import asyncio
from collections.abc import Iterable
from typing import Any, Protocol

from benchmarks.traffic import packets
from benchmarks.traffic.packets import PublishPacket

KEEP_ALIVE = 30
PING = b"\xc0\x00"
GOODBYE = b"\xe0\x00"
USER, PASSWORD, WILL_RETAIN, WILL, CLEAN = 0x80, 0x40, 0x20, 0x04, 0x02


class PacketListener(Protocol):
    """The owner of a line, who receives its packets."""

    def opened(self) -> None:
        pass

    def on_message(self, topic: str, payload: bytes, *, retained: bool) -> None:
        pass

    def acknowledged(self, packet_id: int) -> None:
        pass

    def closed(self) -> None:
        pass


class MqttLine(asyncio.Protocol):
    """One connection of one client."""

    def __init__(
        self,
        owner: PacketListener,
        hello: bytes,
        filters: Iterable[tuple[str, int]],
        keep_alive: int = KEEP_ALIVE,
    ) -> None:
        self._ping_every = keep_alive / 2
        self._owner, self._hello, self._filters = owner, hello, tuple(filters)
        self._buffer = b""
        self._pinging: asyncio.TimerHandle | None = None
        self.refused = ""

    def publish(
        self, topic: str, payload: bytes, packet_id: int = 0, *, retain: bool = False
    ) -> None:
        """Send a message: at QoS 1 when it has a packet id."""
        self._transport.write(
            packets.publish(PublishPacket(topic, payload, int(packet_id > 0), retain, packet_id))
        )

    def leave(self) -> None:
        """Say goodbye, so that the will is forgotten."""
        self._transport.write(GOODBYE)
        self._transport.close()

    def abort(self) -> None:
        """Be gone without a word."""
        self._transport.abort()

    # --- asyncio's side ---------------------------------------------------------------------------

    def connection_made(self, transport: Any) -> None:
        self._transport: asyncio.Transport = transport
        transport.write(self._hello)

    def connection_lost(self, _error: Exception | None) -> None:
        if self._pinging is not None:
            self._pinging.cancel()
        self._owner.closed()

    def data_received(self, data: bytes) -> None:
        data, at = self._buffer + data if self._buffer else data, 0
        while (end := _end(data, at)) is not None:
            start, stop = end
            self._take(data[at], data[start:stop])
            at = stop
        self._buffer = data[at:]

    # --- packets ----------------------------------------------------------------------------------

    def _take(self, first: int, body: bytes) -> None:
        match first >> 4:
            case packets.PUBLISH:
                self._published(first, body)
            case packets.PUBACK:
                self._owner.acknowledged(int.from_bytes(body, "big"))
            case packets.CONNACK if body[1] == packets.ACCEPTED:
                self._transport.write(subscribe(self._filters))
                self._ping()
            case packets.CONNACK:
                self.refused = f"the broker's code {body[1]}"
                self._transport.abort()
            case packets.SUBACK if packets.SUBSCRIPTION_REFUSED in body[2:]:
                self.refused = "a subscription"
                self._transport.abort()
            case packets.SUBACK:
                self._owner.opened()

    def _published(self, first: int, body: bytes) -> None:
        size = int.from_bytes(body[:2], "big") + 2
        topic, rest = body[2:size].decode(), body[size:]
        if first & 0b0110:
            self._transport.write(packets.puback(int.from_bytes(rest[:2], "big")))
            rest = rest[2:]
        self._owner.on_message(topic, rest, retained=bool(first & 1))

    def _ping(self) -> None:
        self._transport.write(PING)
        self._pinging = asyncio.get_running_loop().call_later(self._ping_every, self._ping)


def _end(data: bytes, at: int) -> tuple[int, int] | None:
    """Return (start, end) of the body of the packet at `at`, or None while it is not whole."""
    length = shift = 0
    for index in range(at + 1, min(len(data), at + 5)):
        length |= (data[index] & 0x7F) << shift
        shift += 7
        if not data[index] & 0x80:
            return (index + 1, index + 1 + length) if index + 1 + length <= len(data) else None
    return None


def hello(
    client_id: str,
    user: str,
    password: str,
    will: PublishPacket | None = None,
    keep_alive: int = KEEP_ALIVE,
) -> bytes:
    """Return a CONNECT of a client that keeps nothing at the broker; `keep_alive` in seconds."""
    flags = USER | PASSWORD | CLEAN
    parts = [client_id.encode()]
    if will is not None:
        flags |= WILL | (will.qos << 3) | (WILL_RETAIN if will.retain else 0)
        parts += [will.topic.encode(), will.payload]
    parts += [user.encode(), password.encode()]
    body = (
        _text(b"MQTT")
        + bytes([packets.LEVEL, flags])
        + keep_alive.to_bytes(2, "big")
        + b"".join(_text(part) for part in parts)
    )
    return packets.framed(packets.CONNECT << 4, body)


def subscribe(filters: Iterable[tuple[str, int]]) -> bytes:
    body = (1).to_bytes(2, "big") + b"".join(
        _text(filter_.encode()) + bytes([qos]) for filter_, qos in filters
    )
    return packets.framed(packets.SUBSCRIBE << 4 | 2, body)


def _text(data: bytes) -> bytes:
    return len(data).to_bytes(2, "big") + data
