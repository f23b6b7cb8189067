"""Messages between processes of one robot: four bytes of length, then MessagePack."""

import asyncio
from collections.abc import AsyncIterator
from typing import TypeVar

import msgspec

HEADER = 4  # bytes
LIMIT = 8 << 20  # bytes of the largest message: a map, or a history of some minutes
PIECE = 64 << 10  # bytes read at once
Message = TypeVar("Message")

_encoder = msgspec.msgpack.Encoder()


class WireError(Exception):
    """The other side sent an invalid message."""


def pack(message: msgspec.Struct) -> bytes:
    body = _encoder.encode(message)
    return len(body).to_bytes(HEADER, "big") + body


def length(header: bytes, limit: int = LIMIT) -> int:
    """Return how many bytes follow a header; raises WireError above `limit`."""
    size = int.from_bytes(header, "big")
    if size > limit:
        raise WireError(f"invalid message length: {size} bytes")
    return size


def unpack(decoder: msgspec.msgpack.Decoder[Message], body: bytes) -> Message:
    """Return a message that the decoder knows; raises WireError for any other."""
    try:
        return decoder.decode(body)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        # invalid text is refused by Python, not by msgspec
        raise WireError(str(error)) from error


def take(buffer: bytearray, limit: int = LIMIT) -> bytes | None:
    """Take the first message off a buffer, None while incomplete; raises WireError."""
    if len(buffer) < HEADER:
        return None
    end = HEADER + length(bytes(buffer[:HEADER]), limit)
    if len(buffer) < end:
        return None
    body = bytes(buffer[HEADER:end])
    del buffer[:end]
    return body


async def read(reader: asyncio.StreamReader, limit: int = LIMIT) -> bytes:
    """Return the next message's bytes. Raises WireError for an invalid length, IncompleteReadError
    or OSError when the connection ended.
    """
    return await reader.readexactly(length(await reader.readexactly(HEADER), limit))


async def bodies(reader: asyncio.StreamReader, limit: int = LIMIT) -> AsyncIterator[bytes]:
    """Yield the bytes of every message, with the errors of `read`. Messages that arrive together
    wake the loop once; `read` waits twice for each.
    """
    buffer = bytearray()
    while piece := await reader.read(PIECE):
        buffer += piece
        while (body := take(buffer, limit)) is not None:
            yield body
    raise asyncio.IncompleteReadError(bytes(buffer), None)
