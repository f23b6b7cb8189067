"""One picture as bytes, its time and a JPEG, for pages that no WebRTC path reaches.

On MQTT and, behind its suffix and a newline, in a binary frame of the page's WebSocket: 8 bytes of
capture stamp (Unix time in seconds by the robot's clock, float64, big-endian), then the JPEG from
its first marker to its last.
"""

import math
import struct

from robots.api.errors import Rejection

SUFFIX = "picture"
LATEST = 1e11  # as messages.Stamp
_STAMP = struct.Struct(">d")
_BEGIN, _END = b"\xff\xd8\xff", b"\xff\xd9"


def suffix_for(peer: str | None) -> str:
    """Return the suffix of a picture for all peers that requested one, or for one peer."""
    return SUFFIX if peer is None else f"{SUFFIX}/{peer}"


def is_picture(suffix: str) -> bool:
    return suffix.partition("/")[0] == SUFFIX


def is_for(suffix: str, peer: str) -> bool:
    """Tell whether a picture with this suffix is for the page of a peer."""
    return suffix in {SUFFIX, suffix_for(peer)}


def pack(stamp: float, jpeg: bytes) -> bytes:
    return _STAMP.pack(stamp) + jpeg


def unpack(payload: bytes) -> tuple[float, bytes]:
    """Return (stamp, jpeg) of a picture.

    Raises:
        Rejection: `malformed`: too short, a stamp that is no time, or no JPEG.
    """
    if len(payload) < _STAMP.size:
        raise Rejection("malformed", "picture: too short")
    stamp, jpeg = _STAMP.unpack_from(payload)[0], payload[_STAMP.size :]
    if not (math.isfinite(stamp) and 0.0 <= stamp <= LATEST):
        raise Rejection("malformed", "picture: its stamp is not a time")
    if not (jpeg.startswith(_BEGIN) and jpeg.endswith(_END)):
        raise Rejection("malformed", "picture: not a JPEG")
    return stamp, jpeg


def frame(payload: bytes) -> bytes:
    """Return the binary frame of a WebSocket that holds a picture."""
    return SUFFIX.encode() + b"\n" + payload
