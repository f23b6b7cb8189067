"""The places in the cells of a study, as they count now.

A place that a participant has left who has still to drive (experiments/participation/assignment.py)
is not stored: it depends on when they were last seen.
"""

import datetime
from collections.abc import Sequence

from django.db.models import Max, Q

from experiments.models import Draw, Drive, Participant, Study
from experiments.participation import assignment
from experiments.participation.assignment import Cell, Held

Status = Participant.Status


def next_number(study: Study, kind: str) -> int:
    """Return the number of the next draw of a study and kind; read it before the places."""
    last = Draw.objects.filter(study=study, kind=kind).aggregate(last=Max("number"))["last"]
    return 1 + (last or 0)


def held(study: Study, kind: str, now: datetime.datetime) -> list[Held]:
    """Return the places that people of one kind hold, or held, as they count now: also those of
    draws that were decided and are not written into the participant's row yet.
    """
    definition = study.as_definition()
    allocation, is_told = definition.allocation, definition.reveals_condition
    since = now - datetime.timedelta(hours=allocation.left_after_hours)
    may_leave = allocation.design == "within" or is_told
    draws = _last_draws(study, kind)
    # read before the drives: a participant who drives in between does not count as gone
    people = list(
        Participant.objects.filter(study=study, kind=kind).values_list(
            "pk", "cell", "stage", "draws_applied", "conditions", "status", "seen_at"
        )
    )
    driven = _driven(study, kind) if may_leave else {}
    found = []
    for pk, cell, stage, applied, conditions, status, seen in people:
        nth, drawn, levels = draws.get(pk, (0, "", {}))
        if nth > applied:
            found.append(Held(drawn, "under_way", levels))
        elif cell:
            counted = assignment.stage_now(
                stage,
                conditions=len(conditions),
                done=0 if status == Status.WITHDRAWN else len(driven.get(pk, ())),
                is_gone=may_leave and (status != Status.ACTIVE or seen < since),
                is_told=is_told,
            )
            found.append(Held(cell, counted, levels))
    return found


def free_cells(
    study: Study, kind: str, cells: Sequence[Cell], now: datetime.datetime
) -> list[Cell]:
    """Return the cells, of those given, that a new participant of a kind can get."""
    taken = assignment.load(held(study, kind, now))
    return assignment.open_cells(cells, taken, study.as_definition().allocation.quota)


def _last_draws(study: Study, kind: str) -> dict[object, tuple[int, str, dict[str, str]]]:
    rows = Draw.objects.filter(study=study, kind=kind).order_by("number")
    return {
        participant: (nth, cell, levels)
        for participant, nth, cell, levels in rows.values_list(
            "participant_id", "nth", "cell", "levels"
        )
    }


def _driven(study: Study, kind: str) -> dict[object, set[str]]:
    """Return the conditions in which each participant drove the task; of a drive that is not
    settled yet this is not known, and it counts.
    """
    task = study.as_definition().task
    drives = Drive.objects.filter(
        Q(moved=True) | Q(settled_at=None),
        participant__study=study,
        participant__kind=kind,
        step=task.key if task is not None else "",
    )
    found: dict[object, set[str]] = {}
    for participant, condition in drives.values_list("participant_id", "condition"):
        found.setdefault(participant, set()).add(condition)
    return found
