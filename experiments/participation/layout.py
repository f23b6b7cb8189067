"""The course of a drive, as it was laid out when the robot was granted: the plan may be drawn anew,
what was driven may not.
"""

from typing import Any

import msgspec

from experiments.definition.course import CourseError, CourseTrack, lay_out
from experiments.definition.schema import Condition, StudyDefinition
from experiments.models import Drive
from robots.api import floorplan
from robots.models import Robot


def laid_out(study: StudyDefinition, condition: Condition, robot: Robot) -> dict[str, Any]:
    """Return the course as `Drive.assigned` keeps it under `track`.

    Raises:
        CourseError: the robot's site has no plan, or not the one that the course needs.
    """
    if robot.floor_plan is None or not robot.floor_plan.plan:
        raise CourseError(f"{robot.name} has no floor plan of its site")
    try:
        plan = floorplan.decode(msgspec.json.encode(robot.floor_plan.plan))
    except floorplan.FloorPlanError as error:
        raise CourseError(f"the floor plan of {robot.floor_plan.name} cannot be read") from error
    track: dict[str, Any] = msgspec.to_builtins(lay_out(study, condition, plan))
    return track


def track_of(drive: Drive) -> CourseTrack | None:
    """Return the course of a drive; None for a practice drive, which has none."""
    track = drive.assigned.get("track")
    return msgspec.convert(track, CourseTrack) if track else None
