"""The page at which taking part has ended, with or without a debriefing."""

import datetime

from django.http import HttpRequest, HttpResponse

from experiments.models import Participant, Study
from experiments.participation import completion, progress
from experiments.participation.step_page import render_in_frame
from surveys.documents import spoken


def show_end(
    request: HttpRequest, participant: Participant, now: datetime.datetime
) -> HttpResponse:
    """Return the thanks of a study, and the completion code."""
    if not participant.completion:
        completion.conclude(participant, now)
    last = progress.step_of(participant)
    definition = participant.study.as_definition()
    language = progress.language_of(definition, request.LANGUAGE_CODE)
    more = {
        "text": spoken(last.end_text, language),
        "may_come_again": participant.study.status != Study.Status.CLOSED
        and progress.is_open(participant.study, now),
    }
    return render_in_frame(request, participant, "experiments/debrief.html", more)
