"""Whether the tasks of stored drives end as they are stored when their states and inputs are fed to
a new engine, in a random order and some of them twice.
"""

from collections.abc import Iterable

import numpy as np

from experiments.models import Drive, TaskEvent
from experiments.tasks.engine import TaskEngine
from experiments.tasks.finalization import end
from experiments.tasks.stored_records import offset_of, stored, track_of

TWICE = 0.3  # the share of records that come again


def discrepancies(drives: Iterable[Drive], rng: np.random.Generator) -> list[str]:
    """Return a sentence for each settled drive of a task whose replay differs from it."""
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
    outcome = engine.progress.outcome
    if outcome not in {drive.outcome, None}:
        return (
            f"Session {drive.session_id}: a replay ends as "
            f"{outcome}, but {drive.outcome} is stored."
        )
    found = [(event.type, event.at, event.data()) for event in engine.events]
    rows = TaskEvent.objects.filter(drive=drive).order_by("number")
    if found == list(rows.values_list("type", "stamp", "data")):
        return ""
    return (
        f"Session {drive.session_id}: a replay of its task gives events that differ from the "
        f"stored ones."
    )
