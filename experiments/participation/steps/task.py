"""The page before the drive that the study measures."""

from django.utils.translation import gettext_lazy as _

from experiments.participation.step_page import DrivePage


class TaskStepPage(DrivePage):
    label = _("Task")
    note = _(
        "The task is complete when the participant has passed all checkpoints of the course in "
        "order and docked the robot at the charging station. Otherwise the drive ends when the "
        "time is up, the participant leaves or the connection is lost. It counts with that "
        "outcome, the study continues, and the robot returns to its station by itself if it can."
    )
