"""Moving participants to the next step, and to the next visit. A place is changed only if it is
still the one that was read.
"""

import datetime
from dataclasses import asdict

from experiments.models import Participant, StepVisit
from experiments.participation import completion, journey, progress
from experiments.participation.journey import JourneyPlace
from experiments.participation.steps import page_type

Status = Participant.Status


def go_on(participant: Participant, here: JourneyPlace, now: datetime.datetime) -> bool:
    """Move a participant on from a place; False, and nothing done, when they are elsewhere."""
    try:
        there = next(iter(following(participant, here)), None)
    except journey.NoPlaceError:
        return False
    rows = Participant.objects.filter(pk=participant.pk, status=Status.ACTIVE, **asdict(here))
    if rows.exists():
        # before the move, so that it is repeated after an interruption between the two
        visits = StepVisit.objects.filter(participant=participant, **asdict(here))
        visits.filter(finished_at=None).update(finished_at=now)
    moved = rows.update(**({"status": Status.FINISHED} if there is None else asdict(there)))
    participant.refresh_from_db()
    if not moved:
        return False
    if there is not None:
        progress.see(participant, now)
    if there is None or progress.step_of(participant).is_end:
        completion.conclude(participant, now)
    return True


def following(participant: Participant, here: JourneyPlace) -> list[JourneyPlace]:
    """Return the places that follow in a participant's visit; a NoPlaceError for one that is not on
    their route.
    """
    return journey.following(progress.route_of(participant), here, _skipped(participant))


def _skipped(participant: Participant) -> set[str]:
    """Return the steps that were done for good: consents, and questionnaires about the person."""
    return {
        step.key
        for step in participant.study.as_definition().steps
        if page_type(step.kind).is_done_for_good(participant, step)
    }


def begin_next_visit(participant: Participant, now: datetime.datetime) -> bool:
    """Begin another visit in the same cell; False when the last one is not finished."""
    route = progress.route_of(participant, participant.visit + 1)
    start = journey.begin(route, _skipped(participant))
    moved = Participant.objects.filter(
        pk=participant.pk, status=Status.FINISHED, visit=participant.visit
    ).update(status=Status.ACTIVE, **asdict(start))
    participant.refresh_from_db()
    if moved:
        progress.see(participant, now)
    return bool(moved)
