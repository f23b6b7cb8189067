"""The one reader of a session's stored states: which rows, in which order, in which batches. What
somebody makes of them (columns of a dataset, records of the task engine, a replay) is theirs.

A thousand sessions have more than a million states: the JSON is decoded straight into classes with
no more than what the reader needs, twenty times as fast as into dictionaries.
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
    """Reads a JSON column straight into classes; a database that stores documents gives them as
    they are.
    """

    def __init__(self, kind: Any) -> None:
        super().__init__()
        self._kind, self._decoder = kind, msgspec.json.Decoder(kind)

    def from_db_value(self, value: Any, expression: Any, connection: Any) -> Any:
        """Return what a row holds."""
        return (
            self._decoder.decode(value)
            if isinstance(value, str | bytes)
            else msgspec.convert(value, self._kind)
        )


class StateReader(Generic[S]):
    """Reads states into a class: made once for each class, by the module that wants them so."""

    def __init__(self, kind: type[S]) -> None:
        self._decoded = Decoded(list[kind])  # type: ignore[valid-type]

    def chunks_of(self, session: object) -> Iterator["StoredChunk[S]"]:
        """Yield the stored states of a session, about a second of them at a time, in the order in
        which they were received.

        States that were received late, after a run of the agent had ended, come late here too: who
        wants them run by run sorts by `boot` and `first_seq`. Within a chunk they are in order of
        seq, without holes. No cursor is open while the caller has a chunk.

        Args:
            session: a session, or its key.
        """
        rows = (
            _chunks(session)
            .defer("states")
            .annotate(decoded=ExpressionWrapper(F("states"), output_field=self._decoded))
        )
        for row in iter_batches(rows, CHUNKS_AT_ONCE):
            yield StoredChunk(
                row.boot, row.first_seq, row.received_at, row.clock_offset, row.decoded
            )

    def of(self, session: object) -> Iterator[S]:
        """Yield the stored states of a session in the order in which they were received."""
        for chunk in self.chunks_of(session):
            yield from chunk.states


@dataclass(frozen=True)
class StoredChunk(Generic[S]):
    """Some states of one run of the agent (`boot`), next to each other in seq.

    `received_at` is Unix time in seconds by the server's clock, `clock_offset` the robot's clock
    minus the server's in seconds, None where it was not known.
    """

    boot: str
    first_seq: int
    received_at: float
    clock_offset: float | None
    states: list[S]


def clock_offsets(session: object) -> "QuerySet[StateChunk, float]":
    """Return the clock offsets that are known of a session's states, in the order of `chunks_of`:
    the robot's clock minus the server's, in seconds.
    """
    known = _chunks(session).filter(clock_offset__isnull=False)
    return known.values_list("clock_offset", flat=True)


def newest_chunk(session: object) -> StateChunk | None:
    """Return the row of the states that were received last; None before the first."""
    return _chunks(session).last()


def _chunks(session: object) -> "QuerySet[StateChunk]":
    return StateChunk.objects.filter(session=session).order_by("received_at", "first_seq")
