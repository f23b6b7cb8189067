"""Gathers states into chunks: one row for each second of a session, in order, without gaps or
duplicates.

Because a chunk has no gaps, its first and last seq say exactly which states it has, and a restarted
session manager knows the stored states without reading them. States keep the JSON that the robot
sent: decoding and encoding them would be most of the recorder's work.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

import msgspec

from sessions.recording.items import StateItem

MAX_WAIT = 1.5  # s that a chunk waits for its second to be full
MAX_STATES = 64


@dataclass
class Chunk:
    """Consecutive states of one session and one run of the agent; times in Unix seconds."""

    session: str
    boot: str
    first_seq: int
    first_stamp: float
    received_at: float
    clock_offset: float | None
    last_seq: int
    last_stamp: float
    states: list[msgspec.Raw] = field(default_factory=list)

    def takes(self, seq: int, stamp: float) -> bool:
        """Tell whether a state belongs in this chunk."""
        return (
            seq == self.last_seq + 1
            and int(stamp) == int(self.first_stamp)
            and len(self.states) < MAX_STATES
        )


class Chunks:
    """The open chunks: at most one for each session and run."""

    def __init__(self) -> None:
        self._open: dict[tuple[str, str], Chunk] = {}

    def add(self, session: str, item: StateItem, body: msgspec.Raw) -> Chunk | None:
        """Add a state that no chunk has yet, as `body`; return the chunk that this closed."""
        boot, seq, stamp = item.state.boot, item.state.seq, item.state.stamp
        chunk, closed = self._open.get((session, boot)), None
        if chunk is None or not chunk.takes(seq, stamp):
            closed = chunk
            chunk = self._open[session, boot] = Chunk(
                session, boot, seq, stamp, item.received_at, item.clock_offset, seq, stamp
            )
        chunk.states.append(body)
        chunk.last_seq, chunk.last_stamp = seq, stamp
        return closed

    def ripe(self, now: float) -> Iterator[Chunk]:
        """Close and return the chunks that have waited long enough at `now`, Unix seconds."""
        yield from self._close(
            [key for key, chunk in self._open.items() if now - chunk.received_at >= MAX_WAIT]
        )

    def close(self, session: str | None = None) -> Iterator[Chunk]:
        """Close and return the chunks of a session, or all."""
        yield from self._close([key for key in self._open if session in {None, key[0]}])

    def _close(self, keys: list[tuple[str, str]]) -> Iterator[Chunk]:
        for key in keys:
            yield self._open.pop(key)
