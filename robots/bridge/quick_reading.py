"""Fewer system calls for a client that receives thousands of messages a second.

paho reads a packet's first byte, its length and its body with a system call each, and for every
acknowledgement writes to a socket pair, as if it ran in a thread. Each call releases the
interpreter to the recorder's thread (measured: more than half of the time of a message). Therefore
the socket is read in larger pieces, and the socket pair is removed.

This uses private names of paho-mqtt 2 and aiomqtt 2. If they have changed, or the connection is not
a plain socket (WebSocket), the client stays as it is; a test detects that.
"""

import asyncio
import socket
from collections.abc import Callable
from typing import Any

import aiomqtt

CHUNK = 65536


def read_quickly(client: aiomqtt.Client, chunk: int = CHUNK) -> bool:
    """Make a connected client read in pieces of up to `chunk` bytes; False if it cannot. Call it in
    the client's loop.

    One turn of the loop handles one piece: small pieces let other tasks send in between.
    """
    paho: Any = getattr(client, "_client", None)
    known = all(
        hasattr(paho, name) for name in ("_sock_recv", "_sockpairW", "_in_packet", "loop_read")
    )
    if not known or not isinstance(getattr(paho, "_sock", None), socket.socket):
        return False
    pieces = _Pieces(paho, chunk, getattr(paho._sock, "pending", lambda: 0))
    paho._sock_recv, paho.loop_read, paho._sockpairW = pieces.receive, pieces.read_all, None
    return True


class _Pieces:
    """Data that was read from the socket and not yet by paho: in each turn of the loop one piece,
    and the rest of its last packet.
    """

    def __init__(self, paho: Any, chunk: int, pending: Callable[[], int]) -> None:
        self._paho, self._chunk, self._pending = paho, chunk, pending
        self._receive = paho._sock_recv
        self._read = paho.loop_read
        self._ahead = b""
        self._at = 0
        self._has_read = False

    def receive(self, size: int) -> bytes:
        """Return up to `size` bytes, or raise BlockingIOError, as a socket does, when no more are
        available or allowed in this turn.
        """
        if self._at == len(self._ahead):
            if self._has_read and self._paho._in_packet["command"]:
                return bytes(self._receive(size))
            if self._has_read:
                raise BlockingIOError
            self._ahead, self._at, self._has_read = self._receive(self._chunk), 0, True
        part = self._ahead[self._at : self._at + size]
        self._at += len(part)
        return part

    def read_all(self, max_packets: int = 1) -> Any:
        """Handle every packet of a piece: the socket will not become readable for them again."""
        self._has_read = False
        result = self._read(max_packets)
        while result == 0 and self._at < len(self._ahead):
            result = self._read(max_packets)
        # TLS decrypts a whole record, and the unread rest of it does not make the socket readable
        if result == 0 and self._pending():
            asyncio.get_running_loop().call_soon(self.read_all)
        return result
