"""The page of questions about the person."""

from django.utils.translation import gettext_lazy as _

from experiments.definition.step import AskingStep
from experiments.models import Participant
from experiments.participation.asking_page import AskingPage
from experiments.participation.journey import Place
from experiments.participation.questions import is_answered


class FormStepPage(AskingPage):
    """A questionnaire that is answered once for good."""

    label = _("Form about the person")
    blank = {"questionnaire": "ict"}

    @classmethod
    def is_done_for_good(cls, participant: Participant, step: AskingStep) -> bool:
        """Tell whether it was answered on any visit."""
        return is_answered(participant, Place(1, 0, step.key), step)
