"""The page of a study step, as every kind of step has it. A kind is one file in
experiments/participation/steps/ with one subclass of `StepPage`, beside the file of its definition.
"""

import datetime
from collections.abc import Mapping
from typing import Any, ClassVar

from django.http import HttpRequest, HttpResponse, HttpResponseBase
from django.shortcuts import redirect, render
from django.utils.functional import Promise

from experiments.definition.step import Step
from experiments.models import Participant, Study
from experiments.participation import journey, progress
from surveys.documents import spoken


class StepPage:
    """A step in front of a participant who stands on it."""

    # What the study builder calls it, and what a new one says beside its key and title.
    label: ClassVar[str | Promise]
    blank: ClassVar[Mapping[str, Any]] = {}

    def __init__(self, participant: Participant, step: Any) -> None:
        self.participant, self.step = participant, step

    @classmethod
    def is_done_for_good(cls, _participant: Participant, _step: Any) -> bool:
        """Tell whether a later visit skips it."""
        return False

    def is_done(self) -> bool:
        """Tell whether facts say that the participant goes on."""
        return False

    def show(self, request: HttpRequest, now: datetime.datetime) -> HttpResponseBase:
        """Return the page."""
        raise NotImplementedError

    def take(self, _request: HttpRequest, _now: datetime.datetime) -> HttpResponseBase | None:
        """Take what the page sent; None leads to where the participant is then."""
        return None

    def go_on(self, now: datetime.datetime) -> None:
        """Lead the participant on from here."""
        progress.go_on(self.participant, progress.place(self.participant), now)

    def language(self, request: HttpRequest) -> str:
        """Return the language in which the study speaks."""
        return progress.language_of(self.participant.study.as_definition(), request.LANGUAGE_CODE)

    def render(
        self, request: HttpRequest, template: str, more: dict[str, Any], *, status: int = 200
    ) -> HttpResponse:
        """Return a page in the study's frame (templates/experiments/_frame.html)."""
        return render_in_frame(request, self.participant, template, more, status=status)


def to_step(participant: Participant) -> HttpResponseBase:
    """Lead to the step on which a participant stands."""
    return redirect("study_step", participant.study.slug)


def render_in_frame(
    request: HttpRequest,
    participant: Participant,
    template: str,
    more: dict[str, Any],
    *,
    status: int = 200,
) -> HttpResponse:
    """Return a page in the frame of the step on which a participant stands."""
    definition = participant.study.as_definition()
    language = progress.language_of(definition, request.LANGUAGE_CODE)
    here = progress.place(participant)
    step: Step = progress.step_of(participant)
    number, total = journey.share_done(progress.way_of(participant), here)
    context = {
        "study": participant.study,
        "participant": participant,
        "title": spoken(definition.title, language),
        "language": language,
        "heading": spoken(step.title, language),
        "place": here.word,
        "number": number,
        "total": total,
        "is_draft": participant.study.status == Study.Status.DRAFT,
        **more,
    }
    return render(request, template, context, status=status)
