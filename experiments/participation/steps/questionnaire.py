"""The page of questions about a drive, answered once a visit and round."""

from django.utils.translation import gettext_lazy as _

from experiments.participation.step_page import AskingPage


class QuestionnaireStepPage(AskingPage):
    label = _("Post-drive questionnaire")
    blank = {"questionnaire": "experience"}
