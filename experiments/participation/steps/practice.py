"""The page before a practice drive, which is voluntary."""

import datetime

from django.utils.translation import gettext_lazy as _

from experiments.participation.step_page import DrivePage


class PracticeStepPage(DrivePage):
    label = _("Practice drive")

    def may_do_without(self, now: datetime.datetime) -> bool:
        return self.done.state != "living"
