"""Going on from one step to the next, and coming again.

The order of steps is experiments/participation/journey.py's to say; the page of a step says whether
it was done for good. A place is changed only where it is still the one that was seen.
"""

import datetime

from experiments.models import Participant, StepVisit
from experiments.participation import completion, journey, progress
from experiments.participation.journey import JourneyPlace
from experiments.participation.steps import page_type

Status = Participant.Status


def go_on(participant: Participant, here: JourneyPlace, now: datetime.datetime) -> bool:
    """Lead a participant on from a place; False, and nothing done, when they are elsewhere.

    A participant who arrives at the debriefing, or leaves the last step, is done.
    """
    try:
        there = next(iter(coming(participant, here)), None)
    except journey.NoPlaceError:
        return False
    standing = Participant.objects.filter(
        pk=participant.pk, status=Status.ACTIVE, visit=here.visit, round=here.round, step=here.step
    )
    if standing.exists():
        # before they are led on: what is cut off between the two is done again
        _finish(participant, here, now)
    moved = standing.update(
        **(
            {"round": there.round, "step": there.step}
            if there is not None
            else {"status": Status.FINISHED}
        )
    )
    participant.refresh_from_db()
    if not moved:
        return False
    _arrive(participant, is_end=there is None, now=now)
    return True


def coming(participant: Participant, here: JourneyPlace) -> list[JourneyPlace]:
    """Return the places to which a participant will still come on this visit.

    Raises:
        NoPlaceError: the place is not on their way.
    """
    return journey.coming(progress.way_of(participant), here, _skipped(participant))


def _finish(participant: Participant, here: JourneyPlace, now: datetime.datetime) -> None:
    seen = StepVisit.objects.filter(
        participant=participant, visit=here.visit, round=here.round, step=here.step
    )
    seen.filter(finished_at=None).update(finished_at=now)


def _arrive(participant: Participant, *, is_end: bool, now: datetime.datetime) -> None:
    if not is_end:
        progress.see(participant, now)
    if is_end or progress.step_of(participant).is_end:
        completion.conclude(participant, now)


def _skipped(participant: Participant) -> set[str]:
    """Return the steps that were done for good: what was agreed to, and questions about the person
    that were answered.
    """
    return {
        step.key
        for step in participant.study.as_definition().steps
        if page_type(step.kind).is_done_for_good(participant, step)
    }


def come_again(participant: Participant, now: datetime.datetime) -> bool:
    """Begin another visit of somebody who has finished one; False when they have not. The cell
    stays.
    """
    definition = participant.study.as_definition()
    way = journey.route(
        definition,
        len(participant.conditions) or journey.rounds(definition, progress.access_of(participant)),
        participant.visit + 1,
    )
    start = journey.begin(way, _skipped(participant))
    rows = Participant.objects.filter(
        pk=participant.pk, status=Status.FINISHED, visit=participant.visit
    )
    moved = rows.update(status=Status.ACTIVE, visit=start.visit, round=start.round, step=start.step)
    participant.refresh_from_db()
    if moved:
        progress.see(participant, now)
    return bool(moved)
