"""The page of questions about the person, answered once for good."""

from django.utils.translation import gettext_lazy as _

from experiments.definition.step import AskingStep
from experiments.models import Participant
from experiments.participation.journey import JourneyPlace
from experiments.participation.questions import is_answered
from experiments.participation.step_page import AskingPage


class FormStepPage(AskingPage):
    label = _("Participant questionnaire")
    blank = {"questionnaire": "ict", "version": 2}

    @classmethod
    def is_done_for_good(cls, participant: Participant, step: AskingStep) -> bool:
        return is_answered(participant, JourneyPlace(1, 0, step.key), step)
