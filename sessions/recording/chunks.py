"""States gathered into chunks: one row a second of a session, in order, without holes and without
doubles.

Because a chunk has no holes, its first and last seq say exactly which states it holds, and a
restarted session manager knows what is stored without reading any of it. States stay the JSON that
they came as: taking them apart and writing them again would be most of the recorder's work.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

import msgspec

LONGEST = 1.5  # s that a chunk waits for its second to be full
FULLEST = 64  # states


@dataclass
class Chunk:
    """Some states of one session and one run of the agent, next to each other in seq; times in Unix
    seconds.
    """

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
        """Tell whether a state belongs into this chunk."""
        return (
            seq == self.last_seq + 1
            and int(stamp) == int(self.first_stamp)
            and len(self.states) < FULLEST
        )


class Chunks:
    """The chunks that are being filled: at most one a session and run."""

    def __init__(self) -> None:
        self._open: dict[tuple[str, str], Chunk] = {}

    def add(
        self,
        session: str,
        boot: str,
        seq: int,
        stamp: float,
        body: msgspec.Raw,
        received_at: float,
        offset: float | None,
    ) -> Chunk | None:
        """Take a state that was not there before; return the chunk that it closed."""
        chunk, closed = self._open.get((session, boot)), None
        if chunk is None or not chunk.takes(seq, stamp):
            closed = chunk
            chunk = self._open[session, boot] = Chunk(
                session, boot, seq, stamp, received_at, offset, seq, stamp
            )
        chunk.states.append(body)
        chunk.last_seq, chunk.last_stamp = seq, stamp
        return closed

    def ripe(self, now: float) -> Iterator[Chunk]:
        """Close and return the chunks that have waited long enough; `now` by the clock of
        `received_at`.
        """
        yield from self._close(
            [key for key, chunk in self._open.items() if now - chunk.received_at >= LONGEST]
        )

    def close(self, session: str | None = None) -> Iterator[Chunk]:
        """Close and return the chunks of a session, or all."""
        yield from self._close([key for key in self._open if session in {None, key[0]}])

    def _close(self, keys: list[tuple[str, str]]) -> Iterator[Chunk]:
        for key in keys:
            yield self._open.pop(key)

    def __len__(self) -> int:
        return len(self._open)
