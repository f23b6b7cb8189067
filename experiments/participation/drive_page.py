"""The page before a drive: with which robot, whether it can begin, and the way on without it."""

import datetime
from functools import cached_property
from typing import Any

from django.http import HttpRequest, HttpResponseBase

from experiments.definition.opening_hours import opens_on_the_wall
from experiments.models import Study
from experiments.participation import progress
from experiments.participation.drive_status import DriveStatus, driven, robot_for
from experiments.participation.step_page import StepPage, to_step


class DrivePage(StepPage):
    """What is shown before a drive."""

    @cached_property
    def done(self) -> DriveStatus:
        """How the participant's drive at this place stands."""
        return driven(self.participant, progress.place(self.participant))

    def is_done(self) -> bool:
        """Tell whether the robot was moved."""
        return self.done.standing == "exposed"

    def may_do_without(self, now: datetime.datetime) -> bool:
        """Tell whether somebody may go on without driving: after a drive that never began, or where
        none can begin now.
        """
        if self.done.standing == "living":
            return False
        is_closed = self.participant.study.status == Study.Status.CLOSED
        if self.done.standing == "unexposed" or is_closed:
            return True
        robot, _conditions = robot_for(self.participant, now)
        return robot is None or not robot.is_online(now)

    def take(self, request: HttpRequest, now: datetime.datetime) -> HttpResponseBase | None:
        """Lead on whoever does without, and may."""
        if request.POST.get("go") == "without" and self.may_do_without(now):
            self.go_on(now)
        return None

    def show(self, request: HttpRequest, now: datetime.datetime) -> HttpResponseBase:
        """Show what is to be driven; whoever came when every cell was full is turned away."""
        participant, study, done = self.participant, self.participant.study, self.done
        is_full = not progress.has_place(participant) and progress.is_full(
            study, _access(participant), participant.kind
        )
        if is_full and done.standing == "never":
            progress.screen_out(participant, now)
            return to_step(participant)
        robot, _conditions = robot_for(participant, now)
        more = {
            "driven": done,
            "robot": robot,
            "is_practice": self.step.is_practice,
            "minutes": round(self.step.minutes),
            "is_online": robot is not None and robot.is_online(now),
            "is_closed": study.status == Study.Status.CLOSED,
            "is_full": is_full,
            "opens_at": opens_on_the_wall(study.opening_hours, study.time_zone, now),
            "may_do_without": self.may_do_without(now),
        }
        return self.render(request, "experiments/drive_step.html", more)


def _access(participant: Any) -> Any:
    return "invitation" if participant.access == "invitation" else "open"
