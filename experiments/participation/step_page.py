"""The pages of study steps, as kinds of steps share them. A kind is one file in
experiments/participation/steps/ with one subclass, beside the file of its definition.
"""

import datetime
from collections.abc import Mapping
from functools import cached_property
from typing import Any, ClassVar

from django.http import HttpRequest, HttpResponse, HttpResponseBase
from django.shortcuts import redirect, render
from django.urls import reverse
from django.utils.functional import Promise

from experiments.definition.opening_hours import opens_on_the_wall
from experiments.definition.schema import StudyDefinition
from experiments.definition.step import Step
from experiments.models import LEFT, TECHNICAL_FAILURE, Participant, Study
from experiments.participation import completion, landing, progress, questions
from experiments.participation.drive_status import (
    NEVER,
    DriveStatus,
    driven,
    last_drive,
    longest_wait,
    robot_for,
    series_of,
)
from experiments.recruitment import appointments, recognition, sites
from surveys.definition import language_for
from surveys.documents import BadDefinitionError, Text, spoken
from surveys.models import Questionnaire
from surveys.page_form import Reader, page_form_of

MAY_TRY_AGAIN = frozenset({LEFT, TECHNICAL_FAILURE})


class StepPage:
    """A step in front of a participant who stands on it."""

    # What the study builder calls it, and what a new one says beside its key and title.
    label: ClassVar[str | Promise]
    blank: ClassVar[Mapping[str, Any]] = {}
    # What the study builder tells of it above its form; nothing of most.
    told: ClassVar[str | Promise] = ""

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

    def take(self, _request: HttpRequest, _now: datetime.datetime) -> HttpResponseBase | bool:
        """Take what the page sent: return a page to show, or whether the participant goes on."""
        return False

    def preview(self, request: HttpRequest, now: datetime.datetime) -> HttpResponseBase:
        """Return the page for a researcher who walks through. The participant is in no database:
        nothing is asked of them, and nothing saved.
        """
        return self.show(request, now)

    def language(self, request: HttpRequest) -> str:
        """Return the language in which the study speaks."""
        return progress.language_of(self.participant.study.as_definition(), request.LANGUAGE_CODE)

    def filled(self, text: Text, request: HttpRequest) -> str:
        """Return a text of the study with the participant's earlier answers in it."""
        language = self.language(request)
        return questions.with_answers(self.participant, spoken(text, language), language=language)

    def render(
        self, request: HttpRequest, template: str, more: dict[str, Any], *, status: int = 200
    ) -> HttpResponse:
        """Return a page in the study's frame (templates/experiments/_frame.html)."""
        return render_in_frame(request, self.participant, template, more, status=status)


class AskingPage(StepPage):
    """A questionnaire, to which its address leads."""

    def is_done(self) -> bool:
        """Tell whether it is answered to the end."""
        return questions.is_answered(self.participant, progress.place(self.participant), self.step)

    def show(self, request: HttpRequest, now: datetime.datetime) -> HttpResponseBase:
        """Lead to the questionnaire, begun at the first call."""
        participant, here = self.participant, progress.place(self.participant)
        last = last_drive(participant, here)
        robot = (last.robot.name, series_of(last.robot)) if last.robot is not None else ()
        try:
            response = questions.ask(
                participant,
                here,
                self.step,
                robot=robot,
                outcome=last.outcome,
                return_to=reverse("study_step", args=[participant.study.slug]),
                now=now,
            )
        except (Questionnaire.DoesNotExist, BadDefinitionError):
            return self.render(request, "experiments/trouble.html", {"trouble": "questions"})
        return redirect("survey", response.pk)

    def preview(self, request: HttpRequest, now: datetime.datetime) -> HttpResponseBase:
        """Show a page of the questionnaire with all of its questions: `?page=2`."""
        try:
            definition = questions.definition_of(self.step)
        except (Questionnaire.DoesNotExist, BadDefinitionError):
            return self.render(request, "experiments/trouble.html", {"trouble": "questions"})
        language = language_for(definition, request.LANGUAGE_CODE)
        total = len(definition.pages)
        asked = request.GET.get("page", "")
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
    """What is shown before a drive."""

    @cached_property
    def done(self) -> DriveStatus:
        """How the participant's drive at this place stands."""
        return driven(self.participant, progress.place(self.participant))

    def is_done(self) -> bool:
        """Tell whether the robot was moved."""
        return self.done.standing == "moved"

    def may_do_without(self, now: datetime.datetime) -> bool:
        """Tell whether somebody may go on without driving: after a drive that never began, or where
        none can begin now.
        """
        if self.done.standing == "living":
            return False
        is_closed = self.participant.study.status == Study.Status.CLOSED
        if self.done.standing == "unmoved" or is_closed:
            return True
        robot, _conditions = robot_for(self.participant, now)
        return robot is None or not robot.is_online(now)

    def take(self, request: HttpRequest, now: datetime.datetime) -> bool:
        """Lead on whoever does without, and may."""
        return request.POST.get("go") == "without" and self.may_do_without(now)

    def show(self, request: HttpRequest, now: datetime.datetime) -> HttpResponseBase:
        """Show what is to be driven; whoever came when every cell was full is turned away."""
        participant, study, done = self.participant, self.participant.study, self.done
        is_full = not progress.has_place(participant) and progress.is_full(
            study, progress.access_of(participant), now, participant.kind
        )
        if is_full and done.standing == "never":
            progress.screen_out(participant, now)
            return to_step(participant)
        robot, _conditions = robot_for(participant, now)
        more = {
            "driven": done,
            "robot": robot,
            "is_practice": self.step.is_practice,
            "minutes": round(self.step.minutes),
            "is_online": robot is not None and robot.is_online(now),
            "wait": longest_wait([robot], now) if robot is not None else 0,
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

    def preview(self, request: HttpRequest, now: datetime.datetime) -> HttpResponseBase:
        """Show what is to be driven, as if the robot were there."""
        more = {
            "driven": NEVER,
            "is_practice": self.step.is_practice,
            "minutes": round(self.step.minutes),
            "is_online": True,
            "keeps_place": True,
            "may_drive": True,
        }
        return self.render(request, "experiments/drive_step.html", more)


def show_end(
    request: HttpRequest, participant: Participant, now: datetime.datetime
) -> HttpResponse:
    """Return the page at which taking part has ended: thanks, how it ended, and the way back to the
    recruitment site, or the code for it.
    """
    if not participant.completion:
        completion.conclude(participant, now)
    definition = participant.study.as_definition()
    language = progress.language_of(definition, request.LANGUAGE_CODE)
    texts = {
        "text": progress.step_of(participant).end_text,
        "operator": _told_of_operator(participant, definition),
    }
    more: dict[str, Any] = {
        name: questions.with_answers(participant, spoken(text, language), language=language)
        for name, text in texts.items()
    }
    may_come_again = not is_walk_through(participant) and landing.may_come_again(participant, now)
    more |= {
        "may_come_again": may_come_again,
        "may_try_again": may_come_again and participant.completion in MAY_TRY_AGAIN,
        **way_back(participant),
    }
    return render_in_frame(request, participant, "experiments/debrief.html", more)


def way_back(participant: Participant) -> dict[str, Any]:
    """Return what the template `_code.html` needs: whether the participant returns to their
    recruitment site by a button, and what that site is called.
    """
    came = recognition.arrival_of(participant.study, participant.recruitment)
    profile = sites.PROFILES.get(came.site)
    return {
        "returns": bool(completion.return_address(participant)),
        "site_title": profile.title if profile is not None else "",
    }


def _told_of_operator(participant: Participant, definition: StudyDefinition) -> Text:
    """Return what is told of the hidden operator, to whoever may have met one."""
    met = not participant.conditions or any(map(definition.wizard_of, participant.conditions))
    return definition.operator_text if met else {}


def is_walk_through(participant: Participant) -> bool:
    """Tell whether a participant is in no database: a researcher's, who looks at the pages."""
    return bool(participant._state.adding)


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
    number, total = progress.step_count(participant)
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
    if is_walk_through(participant):
        context |= {"is_walk_through": True, "user": participant.user}
    return render(request, template, context, status=status)
