"""The pages of study steps, as kinds of steps share them. A kind is one file in
experiments/participation/steps/ with one subclass, beside the file of its definition.
"""

from collections.abc import Mapping
from datetime import datetime
from functools import cached_property
from typing import Any, ClassVar

from django.http import HttpRequest, HttpResponse, HttpResponseBase
from django.shortcuts import redirect, render
from django.utils.functional import Promise

from experiments.definition.opening_hours import opens_on_the_wall
from experiments.definition.step import Step
from experiments.models import LEFT, TECHNICAL_FAILURE, Participant, Study
from experiments.participation import (
    completion,
    drive_status,
    grants,
    landing,
    progress,
    questions,
)
from experiments.participation.drive_status import DriveStatus, robot_for
from experiments.recruitment import appointments, recognition, sites
from robots.models import Robot
from surveys.definition import language_for
from surveys.documents import BadDefinitionError, Text, spoken
from surveys.models import Questionnaire
from surveys.page_form import Reader, page_form_of

MAY_TRY_AGAIN = frozenset({LEFT, TECHNICAL_FAILURE})


class StepPage:
    # The kind's name in the study builder, a note above its form, and the fields of a new step
    # beside its key and title.
    label: ClassVar[str | Promise]
    note: ClassVar[str | Promise] = ""
    blank: ClassVar[Mapping[str, Any]] = {}

    def __init__(self, participant: Participant, step: Any) -> None:
        self.participant, self.step = participant, step

    @classmethod
    def is_done_for_good(cls, _participant: Participant, _step: Any) -> bool:
        """Tell whether later visits skip the step."""
        return False

    def is_done(self) -> bool:
        """Tell whether the step is done without a post: answered, agreed to, driven."""
        return False

    def show(self, request: HttpRequest, now: datetime) -> HttpResponseBase:
        raise NotImplementedError

    def take(self, _request: HttpRequest, _now: datetime) -> HttpResponseBase | bool:
        """Take a post: return a page to show, or whether the participant goes on."""
        return False

    def preview(self, request: HttpRequest, now: datetime) -> HttpResponseBase:
        """Return the page of a walk-through, whose participant is not stored; save nothing."""
        return self.show(request, now)

    def language(self, request: HttpRequest) -> str:
        return progress.language_of(self.participant.study.as_definition(), request.LANGUAGE_CODE)

    def filled(self, text: Text, request: HttpRequest) -> str:
        language = self.language(request)
        return questions.with_answers(self.participant, spoken(text, language), language=language)

    def render(
        self, request: HttpRequest, template: str, more: dict[str, Any], *, status: int = 200
    ) -> HttpResponse:
        return render_in_frame(request, self.participant, template, more, status=status)


class AskingPage(StepPage):
    """A questionnaire; the page redirects to it."""

    def is_done(self) -> bool:
        return questions.is_answered(self.participant, progress.place(self.participant), self.step)

    def show(self, request: HttpRequest, now: datetime) -> HttpResponseBase:
        participant, here = self.participant, progress.place(self.participant)
        drive = drive_status.last_drive(participant, here)
        try:
            response = questions.ask(participant, here, self.step, drive=drive, now=now)
        except (Questionnaire.DoesNotExist, BadDefinitionError):
            return self.render(request, "experiments/trouble.html", {"trouble": "questions"})
        return redirect("survey", response.pk)

    def preview(self, request: HttpRequest, now: datetime) -> HttpResponseBase:
        """Show a page of the questionnaire with all of its questions: `?page=2`."""
        try:
            definition = questions.definition_of(self.step)
        except (Questionnaire.DoesNotExist, BadDefinitionError):
            return self.render(request, "experiments/trouble.html", {"trouble": "questions"})
        language = language_for(definition, request.LANGUAGE_CODE)
        total, asked = len(definition.pages), request.GET.get("page", "")
        page = int(asked) if asked in {str(n) for n in range(1, total + 1)} else 1
        reader = Reader(language, seed=0, now=now, sees_all=True)
        outer = questions.progress_around(self.participant, request.LANGUAGE_CODE)
        more = {
            "form": page_form_of(definition, page - 1, reader, range(total)),
            "title": outer.step_title or spoken(definition.title, language),
            "intro": spoken(definition.intro, language) if page == 1 else "",
            "language": language,
            "outer": outer,
            "is_walk_through": True,
            "following": page + 1 if page < total else None,
            "user": self.participant.user,
        }
        return render(request, "surveys/page.html", more)


class DrivePage(StepPage):
    @cached_property
    def done(self) -> DriveStatus:
        return drive_status.status_at(self.participant, progress.place(self.participant))

    def is_done(self) -> bool:
        return self.done.state == "moved"

    def may_do_without(self, now: datetime) -> bool:
        if self.done.state == "living":
            return False
        if self.done.state == "unmoved" or self.participant.study.status == Study.Status.CLOSED:
            return True
        robot = self._robot(now)
        return robot is None or not robot.is_online(now)

    def _robot(self, now: datetime) -> Robot | None:
        """Return the robot to which the participant is led. Where it depends on the condition, the
        condition is drawn first.
        """
        is_open = self.participant.study.status != Study.Status.CLOSED
        if is_open and not drive_status.conditions_on_robot(self.participant):
            grants.draw(self.participant, now)
        return robot_for(self.participant, now)[0]

    def take(self, request: HttpRequest, now: datetime) -> bool:
        return request.POST.get("go") == "without" and self.may_do_without(now)

    def show(self, request: HttpRequest, now: datetime) -> HttpResponseBase:
        """Show the page. Participants who arrive when every cell is full are screened out."""
        participant, study, robot = self.participant, self.participant.study, self._robot(now)
        is_full = not progress.has_place(participant) and progress.is_full(
            study, progress.access_of(participant), now, participant.kind
        )
        if is_full and self.done.state == "never":
            progress.screen_out(participant, now)
            return to_step(participant)
        more = {
            "drive": self.done,
            "robot": robot,
            "is_practice": self.step.is_practice,
            "minutes": round(self.step.minutes),
            "is_online": robot is not None and robot.is_online(now),
            "wait": drive_status.longest_wait([robot], now) if robot is not None else 0,
            "keeps_place": progress.keeps_place(participant),
            "is_closed": study.status == Study.Status.CLOSED,
            "is_full": is_full,
            "opens_at": opens_on_the_wall(study.opening_hours, study.time_zone, now),
            "may_do_without": self.may_do_without(now),
            "appointments": study.as_definition().appointments,
            "appointment": appointments.current(participant),
            "may_drive": appointments.may_drive(participant, now),
        }
        return self.render(request, "experiments/drive_step.html", more)

    def preview(self, request: HttpRequest, now: datetime) -> HttpResponseBase:
        """Show the page as if the robot were free."""
        more = {
            "drive": DriveStatus(),
            "is_practice": self.step.is_practice,
            "minutes": round(self.step.minutes),
            "is_online": True,
            "keeps_place": True,
            "may_drive": True,
        }
        return self.render(request, "experiments/drive_step.html", more)


def show_end(request: HttpRequest, participant: Participant, now: datetime) -> HttpResponse:
    if not participant.completion:
        completion.conclude(participant, now)
    definition = participant.study.as_definition()
    language = progress.language_of(definition, request.LANGUAGE_CODE)

    def filled(text: Text) -> str:
        return questions.with_answers(participant, spoken(text, language), language=language)

    left_drive = completion.has_left_drive(participant)
    may_return = not is_walk_through(participant) and landing.may_take_part_again(participant, now)
    more = {
        "heading": spoken(definition.steps[-1].title, language),
        "text": filled(definition.steps[-1].end_text),
        "operator": filled(definition.operator_text)
        if is_walk_through(participant)
        else questions.operator_text(participant, language),
        "may_take_part_again": may_return,
        "left_drive": left_drive,
        "may_try_again": may_return and not left_drive and participant.completion in MAY_TRY_AGAIN,
        **return_button(participant),
    }
    return render_in_frame(request, participant, "experiments/debrief.html", more)


def return_button(participant: Participant) -> dict[str, Any]:
    """Return the context of the template `_code.html`."""
    came = recognition.arrival_of(participant.study, participant.recruitment)
    return {
        "returns": bool(completion.return_address(participant)),
        "site_title": sites.PROFILES.get(came.site, sites.UNKNOWN).title,
    }


def is_walk_through(participant: Participant) -> bool:
    """Tell whether a participant is not stored, because a researcher looks at the pages."""
    return bool(participant._state.adding)


def to_step(participant: Participant) -> HttpResponseBase:
    return redirect("study_step", participant.study.slug)


def render_in_frame(
    request: HttpRequest,
    participant: Participant,
    template: str,
    more: dict[str, Any],
    *,
    status: int = 200,
) -> HttpResponse:
    """Return a page in the frame of the participant's step (templates/experiments/_frame.html)."""
    definition = participant.study.as_definition()
    language = progress.language_of(definition, request.LANGUAGE_CODE)
    step: Step = progress.step_of(participant)
    number, total = progress.step_count(participant)
    context = {
        "study": participant.study,
        "participant": participant,
        "title": spoken(definition.title, language),
        "language": language,
        "heading": spoken(step.title, language),
        "place": progress.place(participant).word,
        "number": number,
        "total": total,
        "is_draft": participant.study.status == Study.Status.DRAFT,
        **more,
    }
    if is_walk_through(participant):
        context |= {"is_walk_through": True, "user": participant.user}
    return render(request, template, context, status=status)
