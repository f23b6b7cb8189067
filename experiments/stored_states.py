"""The reader of the stored states of a session. A thousand sessions have more than a million
states: JSON is decoded directly into classes with the fields that a reader needs, twenty times as
fast as into dictionaries.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import msgspec
from django.db.models import ExpressionWrapper, F, Field, QuerySet

from sessions.models import StateChunk
from sessions.recording.batches import iter_batches

S = TypeVar("S")

CHUNKS_AT_ONCE = 200


class Decoded(Field):
    """Decodes a JSON column into classes; document databases return it decoded already."""

    def __init__(self, kind: Any) -> None:
        super().__init__()
        self._kind, self._decoder = kind, msgspec.json.Decoder(kind)

    def from_db_value(self, value: Any, expression: Any, connection: Any) -> Any:
        if isinstance(value, str | bytes):
            return self._decoder.decode(value)
        return msgspec.convert(value, self._kind)


class StateReader(Generic[S]):
    """Reads states into a class; one reader for each class."""

    def __init__(self, kind: type[S]) -> None:
        self._decoded = Decoded(list[kind])  # type: ignore[valid-type]

    def chunks_of(self, session: object) -> Iterator["StoredChunk[S]"]:
        """Yield the stored states of a session (or its key), about a second at a time, in order of
        reception, without an open cursor in between.

        States of an earlier run of the agent can be received late: sort by `boot` and `first_seq`
        for runs. Within a chunk, states are in order of seq without gaps.
        """
        decoded = ExpressionWrapper(F("states"), output_field=self._decoded)
        rows = _chunks(session).defer("states").annotate(decoded=decoded)
        for row in iter_batches(rows, CHUNKS_AT_ONCE):
            yield StoredChunk(
                row.boot, row.first_seq, row.received_at, row.clock_offset, row.decoded
            )

    def of(self, session: object) -> Iterator[S]:
        for chunk in self.chunks_of(session):
            yield from chunk.states


@dataclass(frozen=True)
class StoredChunk(Generic[S]):
    """Consecutive states of one run of the agent (`boot`). `received_at` is Unix time in s by the
    server's clock, `clock_offset` the robot's clock minus the server's in s; None: unknown.
    """

    boot: str
    first_seq: int
    received_at: float
    clock_offset: float | None
    states: list[S]


def clock_offsets(session: object) -> "QuerySet[StateChunk, float]":
    """Return the known clock offsets of a session's states in the order of `chunks_of`, in s."""
    known = _chunks(session).filter(clock_offset__isnull=False)
    return known.values_list("clock_offset", flat=True)


def newest_chunk(session: object) -> StateChunk | None:
    return _chunks(session).last()


def _chunks(session: object) -> "QuerySet[StateChunk]":
    return StateChunk.objects.filter(session=session).order_by("received_at", "first_seq")
