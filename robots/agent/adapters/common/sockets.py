"""A TCP connection for velocities: the system buffers nothing that could move a robot later.

Closing such a connection resets it, also when this process is killed: what the peer has not
acknowledged is discarded instead of sent when the network is back. An orderly close therefore
waits for an answer to its last message.
"""

import socket
import struct
import sys
from asyncio.trsock import TransportSocket

UNACKNOWLEDGED = 1000  # milliseconds after which the system drops unacknowledged data
SENDING = 16 << 10  # bytes
RESETTING = struct.pack("hh" if sys.platform == "win32" else "ii", 1, 0)  # struct linger: on, 0 s


def make_prompt(connection: "socket.socket | TransportSocket") -> None:
    """Set these options; what a system does not have is left out."""
    for level, option, value in options():
        connection.setsockopt(level, option, value)


def options() -> list[tuple[int, int, int | bytes]]:
    """Return what to set, as for `setsockopt`."""
    found: list[tuple[int, int, int | bytes]] = [
        (socket.IPPROTO_TCP, socket.TCP_NODELAY, 1),
        (socket.SOL_SOCKET, socket.SO_SNDBUF, SENDING),
        (socket.SOL_SOCKET, socket.SO_LINGER, RESETTING),
    ]
    if hasattr(socket, "TCP_USER_TIMEOUT"):  # Linux
        found.append((socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, UNACKNOWLEDGED))
    return found
