"""The page before a practice drive."""

import datetime

from django.utils.translation import gettext_lazy as _

from experiments.participation.step_page import DrivePage


class PracticeStepPage(DrivePage):
    """Practice, which everybody may do without."""

    label = _("Practice drive")

    def may_do_without(self, now: datetime.datetime) -> bool:
        """Tell whether the participant may go on: always, but while they drive."""
        return self.done.standing != "living"
