"""Whether the tasks of stored drives come out as they are stored when a new engine is told their
records again.

It is told states and inputs alone, in a random order and some of them twice; the stored events are
not asked.
"""

from collections.abc import Iterable

import numpy as np

from experiments.models import Drive, TaskEvent
from experiments.participation.layout import track_of
from experiments.tasks.engine import TaskEngine
from experiments.tasks.finalization import end
from experiments.tasks.stored_records import offset_of, stored

TWICE = 0.3  # the share of records that come again


def discrepancies(drives: Iterable[Drive], rng: np.random.Generator) -> list[str]:
    """Return a sentence for each settled drive of a task that comes out otherwise than it is
    stored.
    """
    return [sentence for drive in drives if (sentence := _difference(drive, rng))]


def _difference(drive: Drive, rng: np.random.Generator) -> str:
    track = track_of(drive)
    if track is None or drive.settled_at is None:
        return ""
    engine = TaskEngine(track)
    records = list(stored(drive, offset_of(drive)))
    records += [record for record in records if rng.random() < TWICE]
    for index in rng.permutation(len(records)):
        engine.feed(records[index])
    end(engine, drive.session)
    if engine.progress.outcome not in {drive.outcome, None}:
        return (
            f"Session {drive.session_id}: a replay ends as "
            f"{engine.progress.outcome}, but {drive.outcome} is stored."
        )
    found = [(event.type, event.at, event.data()) for event in engine.events]
    rows = (
        TaskEvent.objects.filter(drive=drive)
        .order_by("number")
        .values_list("type", "stamp", "data")
    )
    return (
        ""
        if found == list(rows)
        else (
            f"Session {drive.session_id}: a replay of its task gives events that differ from the "
            f"stored ones."
        )
    )
