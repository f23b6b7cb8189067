"""Messages on a stream: whole, partial and invalid ones."""

import asyncio

import msgspec
import pytest
from hypothesis import given, strategies as st

from robots.process import framing


class Note(msgspec.Struct, frozen=True, array_like=True, tag=True):
    text: str


NOTES = msgspec.msgpack.Decoder(Note)


@given(st.lists(st.text(max_size=30), max_size=6), st.integers(1, 9))
def test_messages_of_a_divided_stream_arrive_complete_and_in_order(
    texts: list[str], piece: int
) -> None:
    stream = b"".join(framing.pack(Note(text)) for text in texts)
    buffer, got = bytearray(), []
    for start in range(0, len(stream), piece):
        buffer += stream[start : start + piece]
        while (body := framing.take(buffer)) is not None:
            got.append(framing.unpack(NOTES, body).text)
    assert got == texts
    assert not buffer


def test_a_length_beyond_the_limit_is_refused_before_anything_is_read() -> None:
    assert framing.length(b"\x00\x00\x00\x10", 16) == 16
    with pytest.raises(framing.WireError, match="17 bytes"):
        framing.length(b"\x00\x00\x00\x11", 16)
    with pytest.raises(framing.WireError):
        framing.take(bytearray(b"GET / HTTP/1.1"))


async def test_a_stream_that_ends_in_a_message_raises() -> None:
    reader = asyncio.StreamReader()
    reader.feed_data(framing.pack(Note("one")) + framing.pack(Note("two"))[:-1])
    reader.feed_eof()
    assert framing.unpack(NOTES, await framing.read(reader)) == Note("one")
    with pytest.raises(asyncio.IncompleteReadError):
        await framing.read(reader)


async def test_messages_in_pieces_or_together_are_yielded_one_by_one() -> None:
    reader = asyncio.StreamReader()
    stream = framing.pack(Note("one")) + framing.pack(Note("two")) + framing.pack(Note("three"))
    reader.feed_data(stream[:-3])
    reader.feed_data(stream[-3:])
    reader.feed_data(stream[:5])
    reader.feed_eof()
    bodies = framing.bodies(reader)
    texts = [framing.unpack(NOTES, await anext(bodies)).text for _ in range(3)]
    assert texts == ["one", "two", "three"]
    with pytest.raises(asyncio.IncompleteReadError):
        await anext(bodies)


async def test_a_message_with_invalid_utf_8_is_refused() -> None:
    with pytest.raises(framing.WireError):
        framing.unpack(NOTES, b"\x92\xa4Note\xa1\x80")
