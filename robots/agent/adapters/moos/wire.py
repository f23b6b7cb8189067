"""The wire of MOOS (protocol version 10): packets of messages between a MOOSDB and its clients.
Pure; little endian throughout.

    packet   int32 bytes in all, int32 messages, uint8 compressed (always 0 here), the messages
    message  int32 bytes in all, int32 id, char type, char kind of value, four strings (source, its
             helper, community, variable), three float64 (time, value, second value), the string
             value; a string is int32 bytes, then the bytes
    greeting 32 bytes padded with NUL, then a packet with one message that names the client

Tried against a MOOSDB of its authors.
"""

import struct
from dataclasses import dataclass

GREETING = b"ELKS CAN'T DANCE 2/8/10".ljust(32, b"\0")
NOTIFY, REGISTER, UNREGISTER, WILD_REGISTER = b"N", b"R", b"U", b"*"
DATA, POISON, WELCOME, TIMING, NOTHING = b"i", b"K", b"W", b"T", b"."
ASYNCHRONOUS = "asynchronous"
CLOCK = "_async_timing"
LARGEST = 16 << 20

_PACKET = struct.Struct("<iiB")
_MESSAGE = struct.Struct("<iicc")
_LENGTH = struct.Struct("<i")
_NUMBERS = struct.Struct("<ddd")
HEADER = _PACKET.size

Value = float | str | bytes


class MoosWireError(ValueError):
    """Data that are not of this protocol."""


@dataclass(frozen=True)
class Mail:
    """One message; `text` is a string value, also that of WELCOME and POISON."""

    type: bytes
    key: str = ""
    value: Value = 0.0
    time: float = 0.0
    source: str = ""
    helper: str = ""
    community: str = ""
    number: int = -1
    second: float = -1.0
    text: str = ""


def pack(mails: tuple[Mail, ...] | list[Mail]) -> bytes:
    body = b"".join(map(_pack, mails))
    return _PACKET.pack(HEADER + len(body), len(mails), 0) + body


def body_length(header: bytes) -> tuple[int, int]:
    """Return how many bytes and messages follow a header; raises MoosWireError."""
    size, count, compressed = _PACKET.unpack(header)
    if compressed or not HEADER <= size <= LARGEST or count < 0:
        raise MoosWireError(
            f"invalid packet: {size} bytes, {count} messages, compressed {compressed}"
        )
    return size - HEADER, count


def unpack(body: bytes, count: int) -> list[Mail]:
    """Return the messages of a packet; raises MoosWireError when it is malformed."""
    found, offset = [], 0
    for _ in range(count):
        mail, offset = _unpack(body, offset)
        found.append(mail)
    return found


def _pack(mail: Mail) -> bytes:
    match mail.value:
        case str(text):
            kind, content, number = b"S", text.encode(), -1.0
        case bytes(data):
            kind, content, number = b"B", data, -1.0
        case number:
            kind, content, number = b"D", mail.text.encode(), float(number)
    names = b"".join(
        _string(name.encode()) for name in (mail.source, mail.helper, mail.community, mail.key)
    )
    rest = names + _NUMBERS.pack(mail.time, number, mail.second) + _string(content)
    return _MESSAGE.pack(_MESSAGE.size + len(rest), mail.number, mail.type, kind) + rest


def _string(data: bytes) -> bytes:
    return _LENGTH.pack(len(data)) + data


def _unpack(body: bytes, offset: int) -> tuple[Mail, int]:
    try:
        size, number, kind, value_kind = _MESSAGE.unpack_from(body, offset)
        end = offset + size
        if size < _MESSAGE.size or end > len(body):
            raise MoosWireError(f"invalid message length: {size} bytes")
        at = offset + _MESSAGE.size
        names = []
        for _ in range(4):
            name, at = _read_string(body, at, end)
            names.append(name.decode("utf-8", "replace"))
        stamp, value, second = _NUMBERS.unpack_from(body, at)
        data, _ = _read_string(body, at + _NUMBERS.size, end)
    except struct.error as error:
        raise MoosWireError(f"the message is cut off: {error}") from error
    text = data.decode("utf-8", "replace")
    content: Value = {b"D": value, b"B": data}.get(value_kind, text)
    source, helper, community, key = names
    return Mail(kind, key, content, stamp, source, helper, community, number, second, text), end


def _read_string(body: bytes, at: int, end: int) -> tuple[bytes, int]:
    (size,) = _LENGTH.unpack_from(body, at)
    begin = at + _LENGTH.size
    if size < 0 or begin + size > end:
        raise MoosWireError(f"invalid string length: {size} bytes")
    return body[begin : begin + size], begin + size
