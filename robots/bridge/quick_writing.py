"""Writes a message at QoS 0 to the broker's socket at once, without task, event or turn of the
loop.

For every message aiomqtt creates a coroutine, a task and an event, and paho two objects and a call
of the selector. This costs as much as all the rest of a command's path through a web process, and a
command at QoS 0, which has no answer, needs none of it. Its packet is written to the socket, and
paho gets only what the socket does not accept, and sends it later.

This uses private names of paho-mqtt 2 and aiomqtt 2. If they have changed, or the connection is not
a plain socket (TLS, WebSocket), `writer_of` returns None; a test detects that.
"""

import socket
from typing import Any

import aiomqtt
from paho.mqtt.enums import MessageType

MAX_PENDING = 500  # packets that the socket has not accepted


class QuickWriter:
    """Writes to one connection; everything is called in the client's loop."""

    def __init__(self, paho: Any, plain: socket.socket) -> None:
        self._paho, self._socket = paho, plain

    def publish(self, topic: str, payload: bytes) -> bool:
        """Publish at QoS 0, after pending packets; False when the broker is away or too slow."""
        waiting = self._paho._out_packet
        if len(waiting) >= MAX_PENDING:
            return False
        name = topic.encode()
        packet = bytearray([MessageType.PUBLISH])
        self._paho._pack_remaining_length(packet, 2 + len(name) + len(payload))
        packet += len(name).to_bytes(2, "big") + name + payload
        try:
            sent = 0 if waiting else self._socket.send(packet)
        except BlockingIOError:
            sent = 0
        except OSError:  # the loop will notice
            return False
        if sent < len(packet):
            # Marked as a ping: for a message, paho would call a callback when it has been sent.
            self._paho._packet_queue(MessageType.PINGREQ, bytes(packet[sent:]), 0, 0)
        return True


def writer_of(client: aiomqtt.Client) -> QuickWriter | None:
    """Return a writer for a connected client, or None."""
    paho: Any = getattr(client, "_client", None)
    plain = getattr(paho, "_sock", None)
    known = all(
        hasattr(paho, name) for name in ("_out_packet", "_packet_queue", "_pack_remaining_length")
    )
    return QuickWriter(paho, plain) if known and type(plain) is socket.socket else None
