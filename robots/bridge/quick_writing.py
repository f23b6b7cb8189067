"""A message of its moment written to the broker at once: no task, no event, no turn of the loop.

aiomqtt makes a coroutine, a task and an event of every message, and paho two objects and a look at
the selector, whose costs are those of all the rest of a command on its way through a web process. A
command at QoS 0 needs none of it: nobody answers it. So its packet goes straight into the socket,
and only what the socket does not take goes to paho, which sends it on when there is room.

Touches private names of paho-mqtt 2 and aiomqtt 2; where they are not what they were, or the
connection is no plain socket (TLS, WebSocket), `writer_of` returns None and everything stays as it
is. A test notices when that happens.
"""

import socket
from typing import Any

import aiomqtt
from paho.mqtt.enums import MessageType

MOST_WAITING = 500  # packets that the socket has not taken


class QuickWriter:
    """Writes to one connection; everything is called in the client's loop."""

    def __init__(self, paho: Any, plain: socket.socket) -> None:
        self._paho, self._socket = paho, plain

    def publish(self, topic: str, payload: bytes) -> bool:
        """Publish at QoS 0, behind what already waits; False when the broker is away or does not
        keep up.
        """
        waiting = self._paho._out_packet
        if len(waiting) >= MOST_WAITING:
            return False
        name = topic.encode()
        packet = bytearray([MessageType.PUBLISH])
        self._paho._pack_remaining_length(packet, 2 + len(name) + len(payload))
        packet += len(name).to_bytes(2, "big") + name + payload
        try:
            sent = 0 if waiting else self._socket.send(packet)
        except BlockingIOError:
            sent = 0
        except OSError:  # the loop is about to find out
            return False
        if sent < len(packet):
            # Said to be a ping, because paho would look for somebody to whom to announce that a
            # message has left.
            self._paho._packet_queue(MessageType.PINGREQ, bytes(packet[sent:]), 0, 0)
        return True


def writer_of(client: aiomqtt.Client) -> QuickWriter | None:
    """Return a writer for a connected client; None when it is not of a kind that can."""
    paho: Any = getattr(client, "_client", None)
    plain = getattr(paho, "_sock", None)
    known = all(
        hasattr(paho, name) for name in ("_out_packet", "_packet_queue", "_pack_remaining_length")
    )
    return QuickWriter(paho, plain) if known and type(plain) is socket.socket else None
