"""The page of questions about the drive."""

from django.utils.translation import gettext_lazy as _

from experiments.participation.step_page import AskingPage


class QuestionnaireStepPage(AskingPage):
    """A questionnaire that is answered once a visit and round."""

    label = _("Post-drive questionnaire")
    blank = {"questionnaire": "experience"}
