"""The page before the drive that the study measures."""

from django.utils.translation import gettext_lazy as _

from experiments.participation.step_page import DrivePage


class TaskStepPage(DrivePage):
    """The task."""

    label = _("Task")
