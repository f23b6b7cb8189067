"""The places in the cells of a study, as they are stored and as they count now.

A place that a participant has left who has still to drive (experiments/participation/assignment.py)
is stored nowhere: whether they are gone is a question of when they were last seen.
"""

import datetime

from django.db.models import Q

from experiments.models import Drive, Participant, Study
from experiments.participation import assignment
from experiments.participation.assignment import Held

Status = Participant.Status


def stored(study: Study, kind: str) -> list[Held]:
    """Return the places that people of one kind hold, or held, as they are stored."""
    rows = Participant.objects.filter(study=study, kind=kind).exclude(cell="")
    return [Held(cell, stage) for cell, stage in rows.values_list("cell", "stage")]


def held(study: Study, kind: str, now: datetime.datetime) -> list[Held]:
    """Return the places that people of one kind hold, or held, as they count now."""
    return [place for _number, place in numbered(study, kind, now)]


def numbered(study: Study, kind: str, now: datetime.datetime) -> list[tuple[int, Held]]:
    """Return (number of the draw, place) of everybody of a study and kind who was ever assigned."""
    definition = study.as_definition()
    allocation, is_told = definition.allocation, definition.tells_condition
    rows = Participant.objects.filter(study=study, kind=kind).exclude(cell="")
    if allocation.design == "between" and not is_told:
        found = rows.values_list("drawn_as", "cell", "stage")
        return [(_number_of(word), Held(cell, stage)) for word, cell, stage in found]
    since = now - datetime.timedelta(hours=allocation.left_after_hours)
    # read before what was driven: who drives on in between is not taken for gone
    people = list(
        rows.values_list("pk", "drawn_as", "cell", "stage", "conditions", "status", "seen_at")
    )
    driven = _driven(study, kind)
    return [
        (
            _number_of(word),
            Held(
                cell,
                assignment.stage_now(
                    stage,
                    conditions=len(conditions),
                    done=0 if status == Status.WITHDRAWN else len(driven.get(pk, ())),
                    is_gone=status != Status.ACTIVE or seen < since,
                    is_told=is_told,
                ),
            ),
        )
        for pk, word, cell, stage, conditions, status, seen in people
    ]


def is_last_drawn(participant: Participant) -> bool:
    """Tell whether nobody of the study and kind has been drawn after a participant."""
    others = Participant.objects.filter(study=participant.study, kind=participant.kind).exclude(
        pk=participant.pk
    )
    numbers = (_number_of(word) for word in others.values_list("drawn_as", flat=True))
    return _number_of(participant.drawn_as) > max(numbers, default=0)


def _driven(study: Study, kind: str) -> dict[object, set[str]]:
    """Return the conditions in which each participant drove the task; of a drive that is not
    settled yet this is not known, and it counts.
    """
    task = study.as_definition().task
    drives = Drive.objects.filter(
        Q(exposed=True) | Q(settled_at=None),
        participant__study=study,
        participant__kind=kind,
        step=task.key if task is not None else "",
    )
    found: dict[object, set[str]] = {}
    for participant, condition in drives.values_list("participant_id", "condition"):
        found.setdefault(participant, set()).add(condition)
    return found


def _number_of(word: str) -> int:
    """Return the number of a draw; 0 of an assignment that was made by hand."""
    number = word.rpartition(":")[2]
    return int(number) if ":" in word and number.isdecimal() else 0
