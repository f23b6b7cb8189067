"""The last page: thanks, what the study was about, and the return to the recruitment site."""

import datetime

from django.http import HttpRequest, HttpResponseBase
from django.utils.translation import gettext_lazy as _

from experiments.models import DONE
from experiments.participation import completion
from experiments.participation.step_page import StepPage, show_end


class DebriefStepPage(StepPage):
    label = _("Debriefing")
    blank = {"text": {}}

    def show(self, request: HttpRequest, now: datetime.datetime) -> HttpResponseBase:
        completion.conclude(self.participant, now)
        return show_end(request, self.participant, now)

    def preview(self, request: HttpRequest, now: datetime.datetime) -> HttpResponseBase:
        """Show the end as after a drive that succeeded."""
        self.participant.completion = DONE
        self.participant.completion_code = completion.code(self.participant.study, DONE)
        return show_end(request, self.participant, now)
