"""Transport-wide feedback as a browser sends it."""

import struct

LARGE = 2 << 13 | 1  # a run of one packet, whose difference has 16 bits


def feedback(first: int, count: int, chunks: bytes, ticks: bytes, *, seconds: int = 64) -> bytes:
    """Return an RTCP packet about `count` packets, whose reference time is the last multiple of 64
    ms before `seconds`; `ticks` are differences in 1/4 ms.
    """
    body = struct.pack("!LLHHL", 1, 2, first, count, (seconds * 1000 // 64) << 8) + chunks + ticks
    body += bytes(-len(body) % 4)
    return struct.pack("!BBH", 0x80 | 15, 205, len(body) // 4) + body


def arrival(number: int, seconds: float) -> bytes:
    """Return the report that one packet arrived so long (at most 8 s) after the reference time."""
    return feedback(
        number, 1, struct.pack("!H", LARGE), struct.pack("!h", round(seconds / 0.000_25))
    )
