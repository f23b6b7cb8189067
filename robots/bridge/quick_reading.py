"""Fewer system calls for a client that receives thousands of messages a second.

paho reads a packet's first byte, its length and its body with a system call each, and wakes itself
through a socket pair for every acknowledgement, as if it ran in a thread. Each call gives the
interpreter away, and the recorder's thread takes it (measured: more than half of the time of a
message). So the socket is read a piece at a time, and the socket pair is taken away.

Touches private names of paho-mqtt 2 and aiomqtt 2; where they are not what they were, or the
connection is no plain socket (WebSocket), everything stays as it is. A test notices when that
happens.
"""

import asyncio
import socket
from collections.abc import Callable
from typing import Any

import aiomqtt

CHUNK = 65536


def read_quickly(client: aiomqtt.Client, chunk: int = CHUNK) -> bool:
    """Make a connected client read in pieces of up to `chunk` bytes; False when it is not of a kind
    that can. Call it in the client's loop.

    What a piece holds is handled in one turn of the loop, and no more: who has something to send in
    between wants small ones.
    """
    paho: Any = getattr(client, "_client", None)
    known = all(
        hasattr(paho, name) for name in ("_sock_recv", "_sockpairW", "_in_packet", "loop_read")
    )
    if not known or not isinstance(getattr(paho, "_sock", None), socket.socket):
        return False
    pieces = _Pieces(paho, chunk, getattr(paho._sock, "pending", _nothing))
    paho._sock_recv, paho.loop_read, paho._sockpairW = (
        pieces.receive,
        pieces.read_all,
        None,
    )
    return True


def _nothing() -> int:
    return 0


class _Pieces:
    """What was read of the socket and not yet taken by paho: one piece a turn of the loop, and the
    rest of the packet in which it ends.
    """

    def __init__(self, paho: Any, chunk: int, pending: Callable[[], int]) -> None:
        self._paho, self._chunk, self._pending = paho, chunk, pending
        self._receive = paho._sock_recv
        self._read = paho.loop_read
        self._ahead = b""
        self._at = 0
        self._has_read = False

    def receive(self, size: int) -> bytes:
        """Return up to `size` bytes; raises BlockingIOError when there are none now, or no more in
        this turn, as a socket does.
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
        """Handle every packet of a piece, because the socket will not say again that they are
        there.
        """
        self._has_read = False
        result = self._read(max_packets)
        while result == 0 and self._at < len(self._ahead):
            result = self._read(max_packets)
        # a TLS record is decrypted as a whole, and what is left of it makes the socket readable for
        # nobody
        if result == 0 and self._pending():
            asyncio.get_running_loop().call_soon(self.read_all)
        return result
