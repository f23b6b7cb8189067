"""Whether a study can run with the robots, sites and questionnaires of a server."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from msgspec.structs import replace

from experiments.definition import slowing, wizard as wizards
from experiments.definition.design import OwnAction
from experiments.definition.factors import of_condition
from experiments.definition.problems import length_of, of_course
from experiments.definition.schema import Condition, Course, Network, StudyDefinition
from experiments.definition.step import AskingStep
from robots.api.floorplan import ChargingDock, FloorPlan, Wall
from robots.api.geometry import Pose2D
from robots.api.messages import Capability, Point
from robots.world.inspection import BACKED_OUT, Floor
from robots.world.render_plan import rasterise
from surveys.documents import Problem, ProblemPlace, gettext_noop as _, within

CAPABILITY: dict[OwnAction, Capability] = {
    "places": "goto",
    "map": "goto",
    "follow": "follow",
    "dock": "dock",
    "undock": "undock",
    "tilt": "tilt",
}
NETWORK_LAB: Capability = "network_lab"
# The parts of the accepted ages that are reserved for the real network and the page, in s.
ROOM_FOR_COMMANDS, ROOM_FOR_PICTURES = 0.05, 0.15
ROUNDING = 1e-9
SLOW_COMMANDS = _(
    "commands would arrive up to %(late).0f ms late, and %(robot)s slows down when they are older "
    "than %(age)g ms: it would drive at about %(left).2f m/s instead of %(speed).2f m/s. The "
    "condition would measure the safety limits as well as delay. Delay the video instead (up to "
    "%(most).0f ms), which delays what the driver sees and does, and no command."
)
SLOW_VIDEO = _(
    "video and the commands that answer it would be up to %(late).0f ms late, and %(robot)s slows "
    "down when they are older than %(age)g ms: it would drive at about %(left).2f m/s instead of "
    "%(speed).2f m/s. The condition would measure the safety limits as well as delay. Delay the "
    "video less."
)
SAME_PLACE = 0.5  # largest distance of checkpoint 0 from the docked pose, in metres
CELLS = 2.0  # the distance of free floor from the point before a station


@dataclass(frozen=True)
class RobotFacts:
    """The abilities of a series of robots: its speed limits in m/s and rad/s, and how old commands
    and the frames they are based on may be, in s.
    """

    capabilities: frozenset[str]
    linear: float
    command_age: float = 0.25
    frame_age: float = 1.0
    angular: float = math.inf


@dataclass(frozen=True)
class Known:
    """A server's resources; `questionnaires` are name and version of those that can be asked."""

    sites: Mapping[str, FloorPlan]
    robots: Mapping[str, RobotFacts]
    questionnaires: frozenset[tuple[str, int]]
    interfaces: frozenset[str] = frozenset({"standard"})


def obstacles(study: StudyDefinition, known: Known) -> Iterator[Problem]:
    """Yield why a study without problems of its own is impossible here."""
    for n, step in enumerate(study.steps):
        asked = (step.questionnaire, step.version) if isinstance(step, AskingStep) else None
        if asked and asked not in known.questionnaires:
            words = _("there is no usable questionnaire %(name)s, version %(n)d.")
            wrong = Problem(words, {"name": asked[0], "n": asked[1]})
            yield from within([wrong], ProblemPlace("steps", n), _("Step"), step.key)
    for n, course in enumerate(study.courses):
        yield from of_course(n, course, _of_course(course, known))
    for n, condition in enumerate(study.conditions):
        yield from of_condition(n, condition, _of_condition(study, condition, known))


def dock_of(course: Course, plan: FloorPlan) -> ChargingDock | None:
    """Return the station that a course names, or the only one for its robot."""
    fitting = [dock for dock in _docks(course, plan) if dock.type == course.robot]
    return fitting[0] if len(fitting) == 1 else None


def _docks(course: Course, plan: FloorPlan) -> list[ChargingDock]:
    return [dock for dock in plan.docks if course.dock in {"", dock.name}]


def _of_course(course: Course, known: Known) -> Iterator[Problem]:
    plan = known.sites.get(course.site)
    if plan is None:
        yield Problem(_("there is no site %(name)s."), {"name": course.site})
        return
    yield from _of_dock(course, plan)
    doors, mirrors = {door.name for door in plan.doors}, {mirror.name for mirror in plan.mirrors}
    for name in course.doors:
        if name not in doors:
            yield Problem(_("there is no door %(name)s."), {"name": name})
    if course.photo is not None and course.photo.mirror not in mirrors:
        yield Problem(_("there is no mirror %(name)s."), {"name": course.photo.mirror})
    for one in course.checkpoints:
        is_in_doorway = any(
            math.dist(_middle(it.start, it.end), (one.x, one.y)) <= math.dist(it.start, it.end) / 2
            for it in plan.openings
        )
        if plan.room_at(one.x, one.y) is None and not is_in_doorway:
            words = _("checkpoint %(n)d is not in a room; move it into one.")
            yield _of_checkpoint(words, one.number)


def _of_checkpoint(words: Any, number: int, **values: Any) -> Problem:
    return Problem(words, {"n": number, **values}, path=("checkpoints", number))


def _middle(start: Point, end: Point) -> Point:
    return (start[0] + end[0]) / 2.0, (start[1] + end[1]) / 2.0


def _of_dock(course: Course, plan: FloorPlan) -> Iterator[Problem]:
    named = _docks(course, plan)
    fitting = [dock for dock in named if dock.type == course.robot]
    if not named:
        one = _("there is no charging station %(name)s.")
        words = one if course.dock else _("there is no charging station.")
        yield Problem(words, {"name": course.dock})
    elif not fitting:
        words = _("no charging station of the course fits %(robot)s.")
        yield Problem(words, {"robot": course.robot})
    elif len(fitting) > 1:
        words = _("there are %(n)d charging stations for %(robot)s: name the one to use.")
        yield Problem(words, {"n": len(fitting), "robot": course.robot})
    elif course.checkpoints:
        first, dock = course.checkpoints[0], fitting[0]
        if math.dist((first.x, first.y), (dock.x, dock.y)) > SAME_PLACE:
            words = _("checkpoint %(n)d is not at the charging station %(name)s; move it there.")
            yield _of_checkpoint(words, 0, name=dock.name)


def _of_condition(study: StudyDefinition, condition: Condition, known: Known) -> Iterator[Problem]:
    if condition.interface not in known.interfaces:
        yield Problem(_("there is no interface profile %(name)s."), {"name": condition.interface})
    robot = known.robots.get(condition.robot)
    if robot is None:
        yield Problem(_("there is no robot of the series %(name)s."), {"name": condition.robot})
    else:
        yield from _of_robot(study, condition, robot)
    plan, course = known.sites.get(condition.site), study.course_of(condition)
    wizard = study.wizard_of(condition.key)
    if wizard is not None and robot is not None and plan is not None:
        places = frozenset(place.name for place in plan.places)
        yield from wizards.obstacles(wizard, places, robot.capabilities)
    if plan is not None and course is not None:
        yield from _of_route(condition, course, plan)


def _of_robot(study: StudyDefinition, condition: Condition, robot: RobotFacts) -> Iterator[Problem]:
    action, name = _("%(robot)s cannot do the action %(name)s."), {"robot": condition.robot}
    wanted = {CAPABILITY[one]: Problem(action, {**name, "name": one}) for one in condition.actions}
    if condition.assist != "off":
        words = _("%(robot)s cannot do assistance %(name)s.")
        wanted["assist"] = Problem(words, {**name, "name": condition.assist})
    if condition.controllers:
        wanted["velocity"] = Problem(_("%(robot)s cannot be driven by hand."), name)
    yield from (problem for need, problem in wanted.items() if need not in robot.capabilities)
    yield from _of_network(condition, robot)
    yield from too_fast(condition, robot).values()
    course, task = study.course_of(condition), study.task
    if course is None or task is None:
        return
    if length_of(course) / robot.linear >= task.minutes * 60.0:
        words = _(
            "at %(speed)g m/s, the top speed of %(robot)s, the course takes longer than the task's "
            "%(n)g minutes."
        )
        yield Problem(words, {**name, "speed": robot.linear, "n": task.minutes})


def too_fast(condition: Condition, robot: RobotFacts) -> dict[str, Problem]:
    """Return the speed limits of a condition above those of the robot, by their field."""
    speed = condition.speed
    linear = _(
        "the speed limit of %(asked)g m/s is above the top speed of %(robot)s, %(most)g m/s: lower "
        "it, or leave it blank to use the robot's."
    )
    angular = _(
        "the limit of the turning speed of %(asked).4g °/s is above the top speed of %(robot)s, "
        "%(most).4g °/s: lower it, or leave it blank to use the robot's."
    )
    limits = {
        "linear": (linear, 1.0, speed.linear, robot.linear),
        "angular": (angular, math.degrees(1.0), speed.angular, robot.angular),
    }
    return {
        key: Problem(words, {"asked": asked * unit, "most": most * unit, "robot": condition.robot})
        for key, (words, unit, asked, most) in limits.items()
        if asked is not None and asked > most + ROUNDING
    }


def _of_network(condition: Condition, robot: RobotFacts) -> Iterator[Problem]:
    if condition.network != Network() and NETWORK_LAB not in robot.capabilities:
        words = _("%(robot)s cannot impair its network: remove the delay, loss or limit.")
        yield Problem(words, {"robot": condition.robot})
    there = slowing.latest(condition.network.control)
    round_trip = there + slowing.latest(condition.network.video)
    commands = _(
        "commands would be delayed by up to %(late)g ms; %(robot)s accepts none older than "
        "%(age)g ms, and %(room)g ms of that are reserved for the real network."
    )
    frames = _(
        "video and the commands that answer it would be delayed by up to %(late)g ms; "
        "%(robot)s accepts no command based on video older than %(age)g ms, and %(room)g ms of "
        "that are reserved for the camera and the page."
    )
    limits = (
        (commands, there, robot.command_age, ROOM_FOR_COMMANDS),
        (frames, round_trip, robot.frame_age, ROOM_FOR_PICTURES),
    )
    too_late = [one for one in limits if one[1] > one[2] - one[3] + ROUNDING]
    for words, late, age, room in too_late:
        times = {"late": 1000.0 * late, "age": 1000.0 * age, "room": 1000.0 * room}
        yield Problem(words, {"robot": condition.robot, **times})
    if not too_late:
        yield from _of_slowing(condition, robot)


def _of_slowing(condition: Condition, robot: RobotFacts) -> Iterator[Problem]:
    found = slowing.predicted(condition.network, robot.command_age, robot.frame_age)
    if not condition.controllers or not found.is_slowed:
        return
    speed = min(robot.linear, condition.speed.linear or math.inf)
    there = slowing.latest(condition.network.control)
    words, late, age = SLOW_COMMANDS, there + slowing.REAL_COMMANDS, robot.command_age
    if late <= age / 2.0:
        late = there + slowing.latest(condition.network.video) + slowing.REAL_PICTURES
        words, age = SLOW_VIDEO, robot.frame_age
    values = {
        "robot": condition.robot,
        "late": 1000.0 * late,
        "age": 500.0 * age,
        "left": found.share * speed,
        "speed": speed,
        "refused": 100.0 * found.refused,
        "most": 1000.0 * slowing.longest_video_delay(robot.frame_age),
    }
    yield Problem(words, values)
    if found.refused >= 0.005:
        yield Problem(_("the robot would refuse %(refused).0f%% of the commands."), values)


def _of_route(condition: Condition, course: Course, plan: FloorPlan) -> Iterator[Problem]:
    doors = {door.name for door in plan.doors}
    unknown = [name for name in condition.doors_closed if name not in doors]
    for name in unknown:
        yield Problem(_("there is no door %(name)s to close."), {"name": name})
    dock = dock_of(course, plan)
    if dock is None or unknown:
        return
    words = _("checkpoint %(n)d cannot be reached from the charging station.")
    if condition.doors_closed:
        words = _(
            "checkpoint %(n)d cannot be reached from the charging station with %(doors)s closed."
        )
    floor, closed = _floor(plan, condition.doors_closed), ", ".join(condition.doors_closed)
    x, y = Pose2D(dock.x, dock.y, dock.theta).apply(-BACKED_OUT, 0.0)
    home = floor.about(x, y, CELLS * floor.grid.transform.resolution)[1]
    for one in course.checkpoints[1:]:
        if not home & floor.about(one.x, one.y, one.radius / 2.0)[1]:
            yield _of_checkpoint(words, one.number, doors=closed)


@lru_cache(maxsize=16)
def _floor(plan: FloorPlan, closed: tuple[str, ...]) -> Floor:
    """Return the floor of the site's inspection, where a closed door is a wall."""
    doors = (door for door in plan.doors if door.name in closed)
    leaves = [Wall(start=one.start, end=one.end, thickness=one.thickness) for one in doors]
    return Floor.of(rasterise(replace(plan, walls=(*plan.walls, *leaves))))
