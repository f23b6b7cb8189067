"""The page of a step that asks a questionnaire: that of the questionnaire itself."""

import datetime

from django.http import HttpRequest, HttpResponseBase
from django.shortcuts import redirect
from django.urls import reverse

from experiments.participation import progress, questions
from experiments.participation.drive_status import last_drive, series_of
from experiments.participation.step_page import StepPage
from surveys.documents import BadDefinitionError
from surveys.models import Questionnaire


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
