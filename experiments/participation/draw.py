"""The draw of a participant's cell, as it is written down.

Made at the first grant of the robot, or before: whoever reads instructions that only some
conditions have is drawn when they come to them, and keeps that cell from then on.

Nothing rests on transactions: a draw has a number that no other one of its study has, and the
places that it was decided on are those that stood there before that number, so that of two who are
drawn at the same moment one has to look again.
"""

import datetime
import secrets
from collections.abc import Sequence

import structlog
from django.db import IntegrityError, transaction

from experiments.definition.schema import Condition, StudyDefinition
from experiments.models import Participant
from experiments.participation import assignment, places, progress
from experiments.participation.assignment import AssignmentChoice, Cell, Held

log = structlog.stdlib.get_logger(__name__)

ATTEMPTS = 200  # every failed one means that somebody else was assigned meanwhile


class AssignmentContention(RuntimeError):
    """Somebody else was assigned under every attempt."""


def assigned(participant: Participant, definition: StudyDefinition) -> Condition | None:
    """Return the condition of a participant's round, if it is assigned already."""
    if not progress.has_place(participant):
        return None
    return progress.wanted_condition(participant, definition)


def draw(
    participant: Participant, cells: Sequence[Cell], now: datetime.datetime
) -> Condition | None:
    """Draw the cell of a participant among some, unless they have one, and return the condition of
    their round; None when every cell is full.

    Raises:
        AssignmentContention: somebody else was assigned under every attempt.
    """
    definition = participant.study.as_definition()
    for _ in range(ATTEMPTS):
        if (condition := assigned(participant, definition)) is not None:
            return condition
        held = places.numbered(participant.study, participant.kind, now)
        chosen = choose(cells, held, definition, secrets.randbits(31))
        if chosen is None:
            return None
        if _store(participant, chosen, 1 + max((number for number, _ in held), default=0), now):
            log.info("participant_assigned", study=participant.study_id, cell=chosen.cell.key)
        participant.refresh_from_db()
    raise AssignmentContention(participant.study.slug)


def draw_to_read(participant: Participant, now: datetime.datetime) -> Condition | None:
    """Draw the cell of a participant who is about to read what only some conditions say: among all
    that are open to them.
    """
    definition = participant.study.as_definition()
    cells = assignment.cells(definition, progress.access_of(participant))
    return draw(participant, cells, now)


def choose(
    cells: Sequence[Cell], held: list[tuple[int, Held]], definition: StudyDefinition, seed: int
) -> AssignmentChoice | None:
    """Return what a draw would give; None when every cell is full."""
    return assignment.choose(cells, [place for _, place in held], definition.allocation.quota, seed)


def _store(
    participant: Participant, chosen: AssignmentChoice, number: int, now: datetime.datetime
) -> bool:
    """Write a draw down if its number is still free and nobody else, in another process, has drawn
    for the same participant.
    """
    before = Participant.objects.filter(
        pk=participant.pk, stage=participant.stage, drawn_as=participant.drawn_as
    )
    try:
        # only so that PostgreSQL survives the refusal within a caller's transaction
        with transaction.atomic():
            return bool(
                before.update(
                    cell=chosen.cell.key,
                    conditions=list(chosen.cell.conditions),
                    candidates=list(chosen.candidates),
                    draw_seed=chosen.seed,
                    drawn_as=f"{participant.study_id}:{participant.kind}:{number}",
                    assigned_at=now,
                    stage=Participant.Stage.UNDER_WAY,
                )
            )
    except IntegrityError:
        return False
