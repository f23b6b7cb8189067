"""Bytes to messages and back, with limits on size and range.

All messages are read by `decode`, which checks types and ranges. It raises `Rejection`, which every
caller counts and drops, so that no message can raise an exception into a loop.
"""

from typing import Any

import msgspec

from robots.api import picture, topics
from robots.api.errors import Rejection
from robots.api.messages import Message

_encoder = msgspec.json.Encoder()
# Created by one thread at import: see robots/api/prepared.py.
_decoders: dict[str, Any] = {
    topic.suffix: msgspec.json.Decoder(topic.content)
    for topic in (*topics.TABLE, *topics.DATA_CHANNEL_ONLY)
}
MAX_FRAME = max(topic.limit for topic in topics.TABLE)


def encode(message: Message) -> bytes:
    """Return a message as JSON."""
    return _encoder.encode(message)


def encode_frame(suffix: str, message: Message) -> str:
    """Return a message as a frame of a data channel or a WebSocket: suffix, newline, JSON."""
    return f"{suffix}\n{_encoder.encode(message).decode()}"


def decode(suffix: str, payload: bytes | str, direction: topics.Direction | None = None) -> Any:
    """Return the message in `payload`, of the class that the topic table has for `suffix`.

    Args:
        suffix: a concrete suffix such as `command/velocity` or `signal/p1`.
        payload: JSON, or raw bytes for a photo and a picture.
        direction: when given, a message that travels the other way is refused.

    Raises:
        Rejection: unknown suffix, wrong direction, oversized, or malformed.
    """
    topic = topics.find(suffix)
    if topic is None:
        raise Rejection("unknown_topic", suffix[:80])
    if direction is not None and topic.direction != direction:
        raise Rejection("wrong_direction", suffix)
    data = payload.encode("utf-8", "replace") if isinstance(payload, str) else payload
    if len(data) > topic.limit:
        raise Rejection("oversized", f"{suffix}: {len(data)} > {topic.limit} bytes")
    if topic.content is bytes:
        if picture.is_picture(topic.suffix):
            picture.unpack(data)
        return data
    try:
        return _decoders[topic.suffix].decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise Rejection("malformed", f"{suffix}: {error}") from error


def decode_frame(frame: bytes | str, direction: topics.Direction | None = None) -> tuple[str, Any]:
    """Return (suffix, message) of a frame.

    Raises:
        Rejection: as `decode`, and `malformed` when there is no suffix in front.
    """
    if len(frame) > MAX_FRAME:
        raise Rejection("oversized", f"{len(frame)} bytes")
    text = frame if isinstance(frame, str) else frame.decode("utf-8", "replace")
    suffix, newline, payload = text.partition("\n")
    if not newline:
        raise Rejection("malformed", "no suffix in front of the message")
    return suffix, decode(suffix, payload, direction)
