"""Can a study be run with the robots, sites and questionnaires that are at hand? One sentence for
each thing that stands in the way.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from experiments.definition import wizard as wizards
from experiments.definition.problems import length_of
from experiments.definition.schema import (
    Condition,
    Course,
    Network,
    OwnAction,
    StudyDefinition,
)
from experiments.definition.slowing import (
    REAL_COMMANDS,
    REAL_PICTURES,
    latest,
    longest_video_delay,
    predicted,
)
from robots.api.floorplan import ChargingDock, FloorPlan
from robots.api.geometry import Pose2D
from robots.api.messages import Capability, Point

CAPABILITY: dict[OwnAction, Capability] = {
    "places": "goto",
    "map": "goto",
    "follow": "follow",
    "dock": "dock",
    "undock": "undock",
    "tilt": "tilt",
}
NETWORK_LAB: Capability = "network_lab"
# Of the ages that a robot takes, what the real network and the visitor's own page need for
# themselves, in seconds.
ROOM_FOR_COMMANDS, ROOM_FOR_PICTURES = 0.05, 0.15
ROUNDING = 1e-9
SAME_PLACE = 0.5  # how far checkpoint 0 may lie from the docked pose: metres

Unreachable = Callable[[FloorPlan, Iterable[str], Pose2D, Sequence[tuple[Point, float]]], list[int]]


@dataclass(frozen=True)
class RobotFacts:
    """What a series of robots can do: its speed limits in m/s and rad/s, and how old a command and
    its picture may be, in seconds.
    """

    capabilities: frozenset[str]
    linear: float
    command_age: float = 0.25
    frame_age: float = 1.0
    angular: float = math.inf


@dataclass(frozen=True)
class Known:
    """What is at hand. `questionnaires` has slug and version of those that can be used, not of
    templates.
    """

    sites: Mapping[str, FloorPlan]
    robots: Mapping[str, RobotFacts]
    questionnaires: frozenset[tuple[str, int]]
    interfaces: frozenset[str] = field(default_factory=lambda: frozenset({"standard"}))


def obstacles(study: StudyDefinition, known: Known, unreachable: Unreachable) -> Iterator[str]:
    """Yield what makes a study, which is right in itself, impossible here.

    Args:
        study: without problems of its own.
        known: robots, sites and questionnaires at hand.
        unreachable: tells which points cannot be got to (experiments.definition.reachability, or a
            double).
    """
    for step in study.asking:
        if (step.questionnaire, step.version) not in known.questionnaires:
            yield (
                f"Step {step.key}: there is no usable questionnaire {step.questionnaire}, version"
                f" {step.version}."
            )
    for course in study.courses:
        yield from (
            f"Course of {course.robot} at {course.site}: {problem}"
            for problem in _of_course(course, known)
        )
    for condition in study.conditions:
        yield from (
            f"Condition {condition.key}: {problem}"
            for problem in _of_condition(study, condition, known, unreachable)
        )


def dock_of(course: Course, plan: FloorPlan) -> ChargingDock | None:
    """Return the station of a course: the one that it names, or the only one for its robot; None
    when that is not exactly one.
    """
    fitting = [
        dock for dock in plan.docks if dock.type == course.robot and course.dock in {"", dock.name}
    ]
    return fitting[0] if len(fitting) == 1 else None


def _of_course(course: Course, known: Known) -> Iterator[str]:
    plan = known.sites.get(course.site)
    if plan is None:
        yield f"there is no site {course.site}."
        return
    yield from _of_dock(course, plan)
    doors, mirrors = {door.name for door in plan.doors}, {mirror.name for mirror in plan.mirrors}
    yield from (f"there is no door {name}." for name in course.doors if name not in doors)
    if course.photo is not None and course.photo.mirror not in mirrors:
        yield f"there is no mirror {course.photo.mirror}."
    for checkpoint in course.checkpoints:
        if plan.room_at(checkpoint.x, checkpoint.y) is None and not _in_doorway(
            plan, checkpoint.x, checkpoint.y
        ):
            yield f"checkpoint {checkpoint.number} is not in a room; move it into one."


def _in_doorway(plan: FloorPlan, x: float, y: float) -> bool:
    return any(
        math.dist(_middle(opening.start, opening.end), (x, y))
        <= math.dist(opening.start, opening.end) / 2.0
        for opening in plan.openings
    )


def _middle(start: Point, end: Point) -> Point:
    return (start[0] + end[0]) / 2.0, (start[1] + end[1]) / 2.0


def _of_dock(course: Course, plan: FloorPlan) -> Iterator[str]:
    named = [dock for dock in plan.docks if course.dock in {"", dock.name}]
    fitting = [dock for dock in named if dock.type == course.robot]
    if not named:
        yield (
            f"there is no charging station {course.dock}."
            if course.dock
            else "there is no charging station."
        )
    elif not fitting:
        yield f"no charging station of the course fits {course.robot}."
    elif len(fitting) > 1:
        yield (
            f"there are {len(fitting)} charging stations for {course.robot}: name the one to use."
        )
    elif (
        course.checkpoints
        and math.dist(
            (course.checkpoints[0].x, course.checkpoints[0].y), (fitting[0].x, fitting[0].y)
        )
        > SAME_PLACE
    ):
        yield (f"checkpoint 0 is not at the charging station {fitting[0].name}; move it there.")


def _of_condition(
    study: StudyDefinition, condition: Condition, known: Known, unreachable: Unreachable
) -> Iterator[str]:
    if condition.interface not in known.interfaces:
        yield f"there is no interface profile {condition.interface}."
    robot = known.robots.get(condition.robot)
    if robot is None:
        yield f"there is no robot of the series {condition.robot}."
    else:
        yield from _of_robot(study, condition, robot)
    plan, course = known.sites.get(condition.site), study.course_of(condition)
    wizard = study.wizard_of(condition.key)
    if wizard is not None and robot is not None and plan is not None:
        places = frozenset(place.name for place in plan.places)
        yield from wizards.obstacles(wizard, places, robot.capabilities)
    if plan is not None and course is not None:
        yield from _of_way(condition, course, plan, unreachable)


def _of_robot(study: StudyDefinition, condition: Condition, robot: RobotFacts) -> Iterator[str]:
    wanted: dict[str, str] = {
        CAPABILITY[action]: f"the action {action}" for action in condition.actions
    }
    if condition.assist != "off":
        wanted["assist"] = f"assistance {condition.assist}"
    if condition.controllers:
        wanted["velocity"] = "driving by hand"
    yield from (
        f"{condition.robot} cannot do {what}."
        for capability, what in wanted.items()
        if capability not in robot.capabilities
    )
    yield from _of_network(condition, robot)
    yield from too_fast(condition, robot).values()
    course, task = study.course_of(condition), study.task
    if (
        course is not None
        and task is not None
        and length_of(course) / robot.linear >= task.minutes * 60.0
    ):
        yield (
            f"at {robot.linear:g} m/s, the top speed of {condition.robot}, the "
            f"course takes longer than the task's {task.minutes:g} minutes."
        )


def too_fast(condition: Condition, robot: RobotFacts) -> dict[str, str]:
    """Return why a condition's speed limits are none, by their field: the robot stays below them by
    itself.
    """
    speed = condition.speed
    limits = {
        "linear": ("speed limit", speed.linear, robot.linear, "m/s"),
        "angular": ("limit of the turning speed", speed.angular, robot.angular, "rad/s"),
    }
    return {
        key: (
            f"the {what} of {asked:g} {unit} is above the top speed of {condition.robot},"
            f" {most:g} {unit}: lower it, or leave it blank to use the robot's."
        )
        for key, (what, asked, most, unit) in limits.items()
        if asked is not None and asked > most + ROUNDING
    }


def _of_network(condition: Condition, robot: RobotFacts) -> Iterator[str]:
    """Yield why nobody could drive this robot over such a network, or why it would measure the
    robot's limits on age, which hold in every condition.
    """
    if condition.network != Network() and NETWORK_LAB not in robot.capabilities:
        yield f"{condition.robot} cannot impair its network: remove the delay, loss or limit."
    there, back = latest(condition.network.control), latest(condition.network.video)
    too_late = False
    if there > robot.command_age - ROOM_FOR_COMMANDS + ROUNDING:
        yield (
            f"commands would be delayed by up to {1000.0 * there:g} ms; "
            f"{condition.robot} accepts none older than "
            f"{1000.0 * robot.command_age:g} ms, and "
            f"{1000.0 * ROOM_FOR_COMMANDS:g} ms of that are reserved for the real "
            "network."
        )
        too_late = True
    if there + back > robot.frame_age - ROOM_FOR_PICTURES + ROUNDING:
        yield (
            "video and the commands that answer it would be delayed by up to "
            f"{1000.0 * (there + back):g} ms; {condition.robot} accepts no "
            f"command based on video older than {1000.0 * robot.frame_age:g} ms, "
            f"and {1000.0 * ROOM_FOR_PICTURES:g} ms of that are reserved for the "
            "camera and the page."
        )
        too_late = True
    if not too_late:
        yield from _of_slowing(condition, robot)


def _of_slowing(condition: Condition, robot: RobotFacts) -> Iterator[str]:
    """Yield that the robot's safety kernel would slow the drive down, with the speed that is left
    and what can be done.
    """
    found = predicted(condition.network, robot.command_age, robot.frame_age)
    if not condition.controllers or not found.is_slowed:
        return
    speed = min(robot.linear, condition.speed.linear or math.inf)
    refused = f", and refuse {found.refused:.0%} of the commands" if found.refused >= 0.005 else ""
    there, back = latest(condition.network.control), latest(condition.network.video)
    if there + REAL_COMMANDS > robot.command_age / 2.0:
        least = longest_video_delay(Network(), robot.frame_age)
        cause = (
            f"commands would arrive up to {1000.0 * (there + REAL_COMMANDS):.0f} ms late, and"
            f" {condition.robot} slows down when they are older than"
            f" {500.0 * robot.command_age:g} ms"
        )
        remedy = (
            f"Delay the video instead (up to {1000.0 * least:.0f} ms), which delays what the driver"
            " sees and does, and no command"
        )
    else:
        cause = (
            f"video and the commands that answer it would be up to"
            f" {1000.0 * (there + back + REAL_PICTURES):.0f} ms late, and {condition.robot} slows"
            f" down when they are older than {500.0 * robot.frame_age:g} ms"
        )
        remedy = "Delay the video less"
    yield (
        f"{cause}: it would drive at about {found.share * speed:.2f} m/s instead of"
        f" {speed:.2f} m/s{refused}. The condition would measure the safety limits as well as"
        f" delay. {remedy}."
    )


def _of_way(
    condition: Condition, course: Course, plan: FloorPlan, unreachable: Unreachable
) -> Iterator[str]:
    doors = {door.name for door in plan.doors}
    unknown = [name for name in condition.doors_closed if name not in doors]
    yield from (f"there is no door {name} to close." for name in unknown)
    dock = dock_of(course, plan)
    if dock is None or unknown:
        return
    spots = [
        ((checkpoint.x, checkpoint.y), checkpoint.radius) for checkpoint in course.checkpoints[1:]
    ]
    with_doors = (
        f" with {', '.join(condition.doors_closed)} closed" if condition.doors_closed else ""
    )
    for index in unreachable(
        plan, condition.doors_closed, Pose2D(dock.x, dock.y, dock.theta), spots
    ):
        yield (
            f"checkpoint {course.checkpoints[1:][index].number} cannot be reached from the charging"
            f" station{with_doors}."
        )
