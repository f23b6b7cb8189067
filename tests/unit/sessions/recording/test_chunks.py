"""States gathered into rows."""

import hypothesis.strategies as st
import msgspec
from hypothesis import given

from sessions.recording.chunks import MAX_WAIT, Chunks
from sessions.recording.items import StateItem
from tests.support import words
from tests.support.examples import examples


def state(seq, stamp=0.0, received_at=0.0):
    return StateItem("giraff", words.state(seq, boot="b", stamp=stamp), b"", received_at, None)


def fill(seqs, *, period=0.25, session="s"):
    chunks, closed = Chunks(), []
    for seq in seqs:
        chunk = chunks.add(session, state(seq, seq * period), msgspec.Raw(b"%d" % seq))
        closed += [chunk] if chunk is not None else []
    return closed + list(chunks.close())


def test_a_chunk_is_a_second_of_a_session():
    found = [(one.first_seq, one.last_seq, len(one.states)) for one in fill(range(8, 20))]
    assert found == [(8, 11, 4), (12, 15, 4), (16, 19, 4)]


@examples(100, thorough=2000)
@given(st.lists(st.integers(0, 200), unique=True), st.floats(0.01, 1.0))
def test_chunks_have_every_state_once_without_holes(seqs, period):
    found = []
    for chunk in fill(seqs, period=period):
        first, last = chunk.first_seq, chunk.last_seq
        found += [int(bytes(state)) for state in chunk.states]
        assert found[-len(chunk.states) :] == list(range(first, last + 1))
        assert (chunk.first_stamp, chunk.last_stamp) == (first * period, last * period)
    assert sorted(found) == sorted(seqs)


def test_a_chunk_waits_a_limited_time():
    chunks = Chunks()
    chunks.add("s", state(1, received_at=100.0), msgspec.Raw(b"1"))
    assert list(chunks.ripe(100.0 + MAX_WAIT / 2)) == []
    assert [chunk.first_seq for chunk in chunks.ripe(100.0 + MAX_WAIT)] == [1]
    assert list(chunks.close()) == []


def test_sessions_do_not_mix():
    chunks = Chunks()
    for session in ("s", "t"):
        chunks.add(session, state(1), msgspec.Raw(b"1"))
    assert [chunk.session for chunk in chunks.close("s")] == ["s"]
    assert [chunk.session for chunk in chunks.close()] == ["t"]
