"""The last page: thanks, what the study was about, and the completion code."""

import datetime

from django.http import HttpRequest, HttpResponseBase
from django.utils.translation import gettext_lazy as _

from experiments.participation import completion
from experiments.participation.end_page import show_end
from experiments.participation.step_page import StepPage


class DebriefStepPage(StepPage):
    """Debriefing."""

    label = _("Debriefing")
    blank = {"text": {}}

    def show(self, request: HttpRequest, now: datetime.datetime) -> HttpResponseBase:
        """Note that the participant is through, and show the end."""
        completion.conclude(self.participant, now)
        return show_end(request, self.participant, now)
