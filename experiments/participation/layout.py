"""The course of a drive, as it was laid out when the robot was granted: the plan may be drawn anew,
what was driven may not.
"""

from typing import Any

import msgspec

from experiments.definition.course import CourseError, Track, lay_out
from experiments.definition.schema import Condition, Study
from experiments.models import Drive
from robots.api import floorplan
from robots.models import Robot


def laid_out(study: Study, condition: Condition, robot: Robot) -> dict[str, Any]:
    """Return the course as `Drive.assigned` keeps it under `track`.

    Raises:
        CourseError: the robot's site has no plan, or not the one that the course needs.
    """
    if robot.floor_plan is None or not robot.floor_plan.plan:
        raise CourseError(f"{robot.name} has no plan of its site")
    try:
        plan = floorplan.decode(msgspec.json.encode(robot.floor_plan.plan))
    except floorplan.FloorPlanError as error:
        raise CourseError(f"the plan of {robot.floor_plan.name} cannot be read") from error
    track: dict[str, Any] = msgspec.to_builtins(lay_out(study, condition, plan))
    return track


def track_of(drive: Drive) -> Track | None:
    """Return the course of a drive; None for a practice drive, which has none."""
    track = drive.assigned.get("track")
    return msgspec.convert(track, Track) if track else None
