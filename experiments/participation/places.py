"""The places in the cells of a study, as they count now. Whether a participant has left a place
before driving (experiments/participation/assignment.py) is not stored, because it depends on when
they were last seen.
"""

from collections import defaultdict
from collections.abc import Sequence
from datetime import datetime, timedelta

from django.db.models import Max, Q

from experiments.models import Draw, Drive, Participant, Study
from experiments.participation import assignment
from experiments.participation.assignment import Cell, Held

Status = Participant.Status


def next_number(study: Study, kind: str) -> int:
    """Return the number of the next draw of a study and kind; read it before the places."""
    last = Draw.objects.filter(study=study, kind=kind).aggregate(last=Max("number"))["last"]
    return 1 + (last or 0)


def held(study: Study, kind: str, now: datetime) -> list[Held]:
    """Return the places that participants of a kind hold, or held, also those of draws that are
    decided and not yet applied to the participant's row.
    """
    definition = study.as_definition()
    allocation, reveals = definition.allocation, definition.reveals_condition
    since = now - timedelta(hours=allocation.left_after_hours)
    may_leave = allocation.design == "within" or reveals or bool(definition.practice_keys)
    draws = _last_draws(study, kind)
    # read before the drives: a participant who drives in between does not count as gone
    columns = ("pk", "cell", "stage", "draws_applied", "conditions", "status", "seen_at")
    people = list(Participant.objects.filter(study=study, kind=kind).values_list(*columns))
    done, practised = _exposures(study, kind) if may_leave else ({}, set())
    found = []
    for pk, cell, stage, applied, conditions, status, seen in people:
        nth, drawn, levels = draws.get(pk, (0, "", {}))
        if nth > applied:
            found.append(Held(drawn, "under_way", levels))
        elif cell:
            counted = assignment.stage_now(
                stage,
                conditions=len(conditions),
                done=0 if status == Status.WITHDRAWN else len(done.get(pk, ())),
                is_gone=may_leave and (status != Status.ACTIVE or seen < since),
                knows_condition=reveals or pk in practised,
            )
            found.append(Held(cell, counted, levels))
    return found


def free_cells(study: Study, kind: str, cells: Sequence[Cell], now: datetime) -> list[Cell]:
    taken = assignment.load(held(study, kind, now))
    return assignment.open_cells(cells, taken, study.as_definition().allocation.quota)


def _last_draws(study: Study, kind: str) -> dict[object, tuple[int, str, dict[str, str]]]:
    rows = Draw.objects.filter(study=study, kind=kind).order_by("number")
    columns = ("participant_id", "nth", "cell", "levels")
    return {pk: (nth, cell, levels) for pk, nth, cell, levels in rows.values_list(*columns)}


def _exposures(study: Study, kind: str) -> tuple[dict[object, set[str]], set[object]]:
    """Return the conditions under which each participant was exposed to the task, or may have been,
    and the participants who saw the robot's video in practice.
    """
    practice = study.as_definition().practice_keys
    rows = Drive.objects.filter(participant__study=study, participant__kind=kind)
    drives = rows.filter(Q(exposed_at__isnull=False) | Q(settled_at=None))
    done: dict[object, set[str]] = defaultdict(set)
    practised = set()
    for participant, step, condition in drives.values_list("participant_id", "step", "condition"):
        if step in practice:
            practised.add(participant)
        else:
            done[participant].add(condition)
    return done, practised
