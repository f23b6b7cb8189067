"""The stages of participants, as in a flow diagram (CONSORT 2010, item 13)."""

from collections.abc import Iterable
from typing import Any

from django.db.models import Q

from experiments.models import Drive, Participant, StepResponse, Study

# the page showed the robot's video; before a drive is settled, also: the robot moved
EXPOSED = Q(exposed_at__isnull=False) | Q(session__first_motion_at__isnull=False)


def stages_of(study: Study, rows: Iterable[Participant]) -> dict[Any, str]:
    """Return the last stage that each participant reached (experiments.dataset.levels STAGES), by
    key; for those who withdrew, the stage at that time.

    `ended` needs a drive of the task that ended with an outcome, `answered` also a finished
    response to the questionnaire of the study's table.
    """
    rows, definition = list(rows), study.as_definition()
    own = Q(participant__in=[row.pk for row in rows])
    seen = Drive.objects.filter(own & EXPOSED).exclude(step__in=definition.practice_keys)
    exposed, ended = set(), set()
    for who, *outcomes in seen.values_list("participant_id", "outcome", "session__outcome"):
        exposed.add(who)
        ended.update([who] if any(outcomes) else [])
    responses = StepResponse.objects.filter(
        own,
        response__questionnaire__slug=definition.analysis.statements,
        response__finished_at__isnull=False,
    )
    answered = set(responses.values_list("participant_id", flat=True))

    def stage(row: Participant) -> str:
        if row.withdrawn_stage:
            return str(row.withdrawn_stage)
        if row.pk not in exposed:
            return "assigned" if row.cell else "arrived"
        if row.pk not in ended:
            return "exposed"
        return "answered" if row.pk in answered else "ended"

    return {row.pk: stage(row) for row in rows}
