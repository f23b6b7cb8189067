"""A course in the metres of a site's plan: where a condition's docks, doors and mirrors are."""

import math
from dataclasses import dataclass, replace

from experiments.definition.feasibility import dock_of
from experiments.definition.schema import Condition, Course, StudyDefinition
from robots.api.docked import DOCKED, DockedRule
from robots.api.floorplan import FloorPlan, contains
from robots.api.geometry import Pose2D, wrap_angle
from robots.api.messages import Point
from robots.api.prepared import prepare


class CourseError(ValueError):
    """A course that does not fit the plan; feasibility.py says why."""


@dataclass(frozen=True)
class CourseStop:
    """A checkpoint; `room` is the polygon in which it must be passed, empty in a doorway."""

    number: int
    x: float
    y: float
    radius: float
    room: tuple[Point, ...] = ()

    def is_passed(self, motion: "Motion") -> bool:
        """Tell whether a motion came near enough, on the same side of the walls."""
        x, y = motion.nearest(self.x, self.y)
        return math.dist((x, y), (self.x, self.y)) <= self.radius and (
            not self.room or contains(self.room, x, y)
        )

    def distance(self, x: float, y: float) -> float:
        return math.dist((x, y), (self.x, self.y))


@dataclass(frozen=True)
class Doorway:
    """A door of the plan; `required` if the course names it and the condition leaves it open."""

    name: str
    start: Point
    end: Point
    required: bool

    def distance(self, x: float, y: float) -> float:
        """Return how far a point is from the closed leaf, in metres."""
        return math.dist(Motion(self.start, self.end).nearest(x, y), (x, y))


@dataclass(frozen=True)
class Sight:
    """A robot's view of a mirror: `bearing` of its reflection (radians, counter-clockwise) and
    `distance` in metres. `before`: it faces the glass; `sees`: the camera shows the reflection.
    """

    bearing: float
    distance: float
    before: bool
    sees: bool


@dataclass(frozen=True)
class PhotoSpot:
    """The place of the photo and the mirror, whose glass is to the left of start → end."""

    stop: CourseStop
    radius: float
    view: float
    start: Point
    end: Point

    def sight(self, pose: Pose2D) -> Sight:
        """Return how a robot at `pose` sees the mirror. The reflection is at the foot of the
        perpendicular on the mirror's line: visible if that is on the glass and within `view` of the
        camera's axis.
        """
        along = (self.end[0] - self.start[0], self.end[1] - self.start[1])
        length = math.hypot(*along)
        dx, dy = pose.x - self.start[0], pose.y - self.start[1]
        share = (dx * along[0] + dy * along[1]) / length**2
        distance = (along[0] * dy - along[1] * dx) / length
        # against the normal of the glass, (-along_y, along_x)
        towards = math.atan2(-along[0], along[1])
        bearing = wrap_angle(towards - pose.theta)
        before = distance > 0.0 and 0.0 <= share <= 1.0
        return Sight(bearing, distance, before, before and abs(bearing) <= self.view)


@dataclass(frozen=True)
class Motion:
    """A straight motion of the robot's centre, in metres; a point without known motion."""

    start: Point
    end: Point

    def nearest(self, x: float, y: float) -> Point:
        (ax, ay), (bx, by) = self.start, self.end
        dx, dy = bx - ax, by - ay
        square = dx * dx + dy * dy
        along = ((x - ax) * dx + (y - ay) * dy) / square if square else 0.0
        share = min(1.0, max(0.0, along))
        return ax + share * dx, ay + share * dy

    def crosses(self, start: Point, end: Point) -> bool:
        """Tell whether it crosses a doorway between its posts; a point on the line counts as on
        the right-hand side.
        """
        before, after = _side(start, end, self.start), _side(start, end, self.end)
        if (before > 0.0) == (after > 0.0):
            return False
        share = before / (before - after)
        x = self.start[0] + share * (self.end[0] - self.start[0])
        y = self.start[1] + share * (self.end[1] - self.start[1])
        dx, dy = end[0] - start[0], end[1] - start[1]
        return 0.0 <= (x - start[0]) * dx + (y - start[1]) * dy <= dx**2 + dy**2


def _side(start: Point, end: Point, point: Point) -> float:
    """Return twice the area of the triangle: positive to the left of start → end."""
    return (end[0] - start[0]) * (point[1] - start[1]) - (end[1] - start[1]) * (point[0] - start[0])


@dataclass(frozen=True)
class CourseTrack:
    """The course as the task engine needs it. `stops` are checkpoints 1, 2 …; `limit` and `last`
    (the announced remainder) in s. `docked` is None in drives from before there was a rule: there,
    one state in the station counts as docked.
    """

    dock: Pose2D
    stops: tuple[CourseStop, ...]
    doorways: tuple[Doorway, ...]
    photo: PhotoSpot | None
    limit: float
    last: float
    docked: DockedRule | None = None


prepare(CourseTrack)


def lay_out(study: StudyDefinition, condition: Condition, plan: FloorPlan) -> CourseTrack:
    """Return the course of a condition on a plan. CourseError: they do not fit together."""
    course, task = study.course_of(condition), study.task
    dock = dock_of(course, plan) if course is not None else None
    if course is None or task is None or dock is None:
        raise CourseError(f"no course for condition {condition.key} on the plan {plan.map_id}")
    rooms = [plan.room_at(one.x, one.y) for one in course.checkpoints[1:]]
    stops = tuple(
        CourseStop(one.number, one.x, one.y, one.radius, room.polygon if room is not None else ())
        for one, room in zip(course.checkpoints[1:], rooms, strict=True)
    )
    required = set(course.doors) - set(condition.doors_closed)
    doorways = tuple(
        Doorway(door.name, door.start, door.end, door.name in required) for door in plan.doors
    )
    pose, photo = Pose2D(dock.x, dock.y, dock.theta), _photo(course, stops, plan)
    limit, last = task.minutes * 60.0, task.last_minutes * 60.0
    docked = replace(DOCKED, seconds=task.docked_seconds)
    return CourseTrack(pose, stops, doorways, photo, limit, last, docked)


def _photo(course: Course, stops: tuple[CourseStop, ...], plan: FloorPlan) -> PhotoSpot | None:
    photo = course.photo
    if photo is None:
        return None
    mirror = next((mirror for mirror in plan.mirrors if mirror.name == photo.mirror), None)
    stop = next((stop for stop in stops if stop.number == photo.checkpoint), None)
    if mirror is None or stop is None:
        missing = f"no mirror {photo.mirror} or no checkpoint {photo.checkpoint}"
        raise CourseError(f"{missing} on the plan {plan.map_id}")
    return PhotoSpot(stop, photo.radius, photo.view, mirror.start, mirror.end)
