"""A whole robot in a whole site, without a clock of its own: call `step(dt)`, then read the state.

All randomness comes from one seed, in a stream for each use, so that reading a scan does not change
the drive. The same seed and the same commands at the same times give the same trajectory, bit for
bit.

The wheels slip, which the encoders do not notice, and the encoders assume slightly wrong wheels:
`odometry` drifts from the truth as a real robot's does.
"""

import math
from typing import NamedTuple

import numpy as np

from robots.api.floorplan import DoorState, FloorPlan
from robots.api.geometry import Pose2D, wrap_angle
from robots.simulator.physics import battery, range_sensors
from robots.simulator.physics.contact import (
    RELEASE,
    Obstacles,
    Shape,
    distance_to,
    place,
    shape,
)
from robots.simulator.physics.doors import Doors
from robots.simulator.physics.drive import (
    STILL,
    WheelMotion,
    advance,
    clamp,
    draw_encoders,
    follow,
    reckoned,
    slip,
    tilted,
)
from robots.simulator.physics.pedestrians import Pedestrians
from robots.simulator.physics.people import BODY, Person, legs, name_of, solid
from robots.simulator.physics.random_doors import RandomDoors
from robots.simulator.wire import Faults
from robots.world.robot_models import RobotModel
from robots.world.sensing import LaserScan
from robots.world.sites import with_doors
from robots.world.solids import Floats, Opening, fixed_solids, leaf_solid

NEAR = 0.1  # metres beyond touch at which people are checked; more than they move in a step
PERSON = shape(solid(Person(0.0, 0.0, 0.0, 0.0, 0, 0.0)))
AT_DOCK = 1.0  # metres from a dock beyond which the exact pose does not matter
# seconds in which a robot that was walked into is not at fault when it pushes on
BUMP_TIME = 1.0


class StartError(ValueError):
    """The robot cannot be put there; the message is one sentence."""


class TrueState(NamedTuple):
    """One moment of the truth; `time` in seconds since the start of the simulation."""

    time: float
    commanded_linear: float
    commanded_angular: float
    linear: float
    angular: float
    x: float
    y: float
    theta: float


class Simulation:
    """The robot. Attributes are the truth at `time`; only `step` changes them."""

    def __init__(
        self,
        model: RobotModel,
        plan: FloorPlan,
        *,
        seed: int,
        start: str = "dock",
        charge: float = 0.9,
        people: int = 0,
        door_changes: float = 0.0,
    ) -> None:
        """Start at `dock`, at the start or place of that name in the plan, or at `x,y,theta`.

        `people` walk about, and every `door_changes` seconds, on average, a door opens or closes
        (0: never).

        Raises:
            StartError: no such place, or it is occupied.
        """
        self.model, self.plan = model, plan
        streams = [np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(6)]
        self.drive_rng, self.laser_rng, self.sonar_rng = *streams[:2], streams[5]
        self.encoders = draw_encoders(
            model.odometry.radius_error, model.odometry.separation_error, streams[2]
        )
        self.footprint = np.array(model.footprint)
        self._radius = model.radius
        self._doors = Doors(plan, with_doors(plan, {}))
        self._random_doors = RandomDoors(tuple(self.doors), door_changes, streams[3])
        self._fixed = fixed_solids(plan)
        self.obstacles = self._obstacles_at_rest()
        self.time = 0.0
        self.pose = start_pose(plan, model, start)
        self.motion = STILL
        self.commanded = STILL
        self.commanded_at = -math.inf
        self.odometry = Pose2D(0.0, 0.0, 0.0)
        self.distance = 0.0
        self.contacts = 0
        self.touching: frozenset[str] = frozenset()
        self.charge = charge
        self.tilt = model.tilt.home if model.tilt else 0.0
        self.tilt_target = self.tilt
        self.faults = Faults()
        self._pedestrians: Pedestrians | None = None
        self.docked = False  # whether the charging contacts meet
        self._refuse_blocked(start, self.pose)
        if people:
            at = (self.pose.x, self.pose.y)
            self._pedestrians = Pedestrians(plan, people, self.doors, at, streams[4])
        self.docked = self._in_dock()

    @property
    def people(self) -> tuple[Person, ...]:
        return self._pedestrians.people if self._pedestrians else ()

    @property
    def doors(self) -> dict[str, DoorState]:
        """The rest position of every door, or its last one while it moves."""
        return self._doors.states

    @property
    def openings(self) -> dict[str, Opening]:
        """The opening of every door: its state at rest, or its share of the swing in motion."""
        return self._doors.openings

    @property
    def bumped(self) -> int:
        """The number of times that people walked into the robot; `contacts` counts what the robot
        ran into.
        """
        return self._pedestrians.bumped if self._pedestrians else 0

    def outline(self) -> Floats:
        """Return the footprint (n, 2) in the world."""
        return place(self.footprint, self.pose)

    def command(self, linear: float, angular: float) -> WheelMotion:
        """Set the target velocity, clamped, and return it; after `model.watchdog` s it brakes."""
        self.commanded = clamp(WheelMotion(linear, angular), self.model.limits)
        self.commanded_at = self.time
        return self.commanded

    def set_doors(self, doors: dict[str, DoorState]) -> None:
        """Swing doors open or closed; a leaf waits while it would touch a robot or a person.

        Unknown names are ignored. These doors no longer move by themselves. Before the first step
        they are set at once.
        """
        self._random_doors.leave(set(doors))
        self._doors.want(doors)
        if self.time == 0.0 and self._doors.set_at_once(self._keep_clear()):
            self.obstacles = self._obstacles_at_rest()

    def carry_to(self, pose: Pose2D) -> None:
        """Put the robot elsewhere, unnoticed by odometry; StartError where it is not free."""
        where = f"{pose.x:g},{pose.y:g},{pose.theta:g}"
        if self.plan.room_at(pose.x, pose.y) is None:
            raise StartError(f"{where} is not in a room")
        self._refuse_blocked(where, pose)
        self.pose = pose
        self.motion, self.touching = STILL, frozenset()
        self.docked = False
        self.docked = self._in_dock()

    def step(self, dt: float) -> None:
        """Let `dt` seconds pass, a few hundredths of a second."""
        self._doors.want(self._random_doors.due(self.time))
        if not self._doors.is_still() and self._doors.step(dt, self._keep_clear()):
            self.obstacles = self._obstacles_at_rest()
        if self.model.tilt:
            self.tilt = tilted(self.tilt, self.tilt_target, self.model.tilt, dt)
        if self._target() != STILL or self.motion != STILL:
            self._drive(dt)
        if self._pedestrians:
            self._pedestrians.step(dt, self.doors, self.footprint, self.pose, self._doors.moving)
        self.docked = self._in_dock()
        effort = max(
            abs(self.motion.linear) / self.model.limits.linear,
            abs(self.motion.angular) / self.model.limits.angular,
        )
        self.charge = battery.step(
            self.charge, self.model.battery, effort, dt, charging=self.docked
        )
        self.time += dt

    def scan(self) -> Floats:
        """Return ranges (beams,) in metres, `inf` for no return, NaN from a broken laser."""
        ranges = range_sensors.scan(self._segments(), self.pose, self.model.laser, self.laser_rng)
        return np.full_like(ranges, math.nan) if self.faults.laser == "nan" else ranges

    def echoes(self, sounding: tuple[int, ...]) -> tuple[float, ...]:
        """Return metres from each sounding sonar, `inf` for no echo."""
        mounts, segments = self.model.sonar.mounts(self.model.footprint), self._segments()
        return tuple(
            range_sensors.echo(
                segments, self.pose.compose(mounts[index]), self.model.sonar, self.sonar_rng
            )
            for index in sounding
        )

    def bumper(self) -> tuple[float, ...]:
        """Return bearings of contacts (radians, robot's frame), except a station's."""
        if not self.touching:
            return ()
        outline = self.outline()
        normals = [
            each.gap_to(outline)[1]
            for each in (*self.obstacles.shapes, *self._near(self.pose))
            if each.solid.name in self.touching and each.solid.kind != "station"
        ]
        return tuple(wrap_angle(math.atan2(-y, -x) - self.pose.theta) for x, y in normals)

    def _segments(self) -> Floats:
        """Return the sides (n, 4) of everything at the height of the sensors."""
        segments = self.obstacles.segments
        if self.people or self._doors.moving:
            segments = np.concatenate(
                [segments, *(leaf.sides for leaf in self._doors.moving), legs(self.people)]
            )
        return segments

    def beams(self) -> LaserScan | None:
        """Return the scan with its mount, stamped with `time`; None from a silent laser."""
        if self.faults.laser == "silent":
            return None
        eye = self.model.laser
        return LaserScan(
            self.time, eye.angle_min, eye.angle_increment, eye.range_max, self.scan(), eye.mount
        )

    def clearance(self) -> float:
        """Return the distance in metres from the footprint to the nearest thing or person."""
        outline = self.outline()
        gaps = [distance_to(person.x, person.y, outline) - BODY for person in self.people]
        leaves = Obstacles(tuple(leaf.solid for leaf in self._doors.moving))
        return max(0.0, min([self.obstacles.clearance(outline), leaves.clearance(outline), *gaps]))

    def voltage(self) -> float:
        return battery.voltage(self.charge, self.model.battery, charging=self.docked)

    def sample(self) -> TrueState:
        return TrueState(self.time, *self.commanded, *self.motion, *self.pose)

    def errors(self) -> tuple[str, ...]:
        return ("battery empty",) if self.charge <= 0.0 else ()

    def _target(self) -> WheelMotion:
        silent = self.time - self.commanded_at > self.model.watchdog
        stopped = silent or self.charge <= 0.0 or self.faults.wheels_stopped
        return STILL if stopped else self.commanded

    def _drive(self, dt: float) -> None:
        model = self.model
        self.motion = follow(self.motion, self._target(), model.limits, dt)
        real = slip(self.motion, model.wheel_separation, model.wheel_noise, dt, self.drive_rng)
        others = self._near(self.pose)
        move = self.obstacles.move(self.footprint, self.pose, real, dt, others)
        reported = reckoned(self.motion, model.wheel_separation, self.encoders)
        self.odometry = advance(self.odometry, reported, dt)
        self.distance += math.hypot(move.pose.x - self.pose.x, move.pose.y - self.pose.y)
        self.pose = move.pose
        if move.touched:
            self.motion = move.motion
        if move.touched or self.touching:
            self._count_contacts(others, move.touched)

    def _near(self, pose: Pose2D) -> tuple[Shape, ...]:
        """Return people near enough to be bumped into, and the moving leaves."""
        reach = self._radius + BODY + NEAR
        near = (
            PERSON.moved(name_of(person), person.x, person.y)
            for person in self.people
            if math.hypot(person.x - pose.x, person.y - pose.y) < reach
        )
        return (*self._doors.moving, *near)

    def _count_contacts(self, others: tuple[Shape, ...], touched: frozenset[str]) -> None:
        """Count contacts: from a touch until the gap has opened again; a dock is none."""
        excused = {
            name_of(person)
            for person in self.people
            if self._pedestrians and self._pedestrians.just_bumped(person.look, BUMP_TIME)
        }
        shapes = {each.solid.name: each for each in (*self.obstacles.shapes, *others)}
        new = touched - self.touching - excused
        self.contacts += sum(shapes[name].solid.kind != "station" for name in new)
        outline = self.outline()
        still = {
            name
            for name in self.touching - touched
            if name in shapes and shapes[name].gap_to(outline)[0] < RELEASE
        }
        self.touching = frozenset((touched - excused) | still)

    def _refuse_blocked(self, where: str, pose: Pose2D) -> None:
        blocked = self.obstacles.hits(place(self.footprint, pose), self._near(pose))
        if blocked:
            raise StartError(
                f"the robot cannot be put at {where!r}: {blocked[0].solid.name} is in that spot"
            )

    def _in_dock(self) -> bool:
        tolerance = self.model.dock
        travel, twist = (tolerance.travel, tolerance.twist) if self.docked else (0.0, 0.0)
        for dock in self.plan.docks:
            away = abs(dock.x - self.pose.x) + abs(dock.y - self.pose.y)
            if dock.type != self.model.series or away > AT_DOCK:
                continue
            error = Pose2D(dock.x, dock.y, dock.theta).inverse().compose(self.pose)
            reaches = (
                abs(error.x) <= tolerance.longitudinal + travel
                and abs(error.y) <= tolerance.lateral + travel
            )
            if reaches and abs(error.theta) <= tolerance.heading + twist:
                return True
        return False

    def _obstacles_at_rest(self) -> Obstacles:
        leaves = tuple(leaf_solid(door, self.doors[door.name]) for door in self._doors.resting)
        return Obstacles((*self._fixed, *leaves))

    def _keep_clear(self) -> list[Floats]:
        """Return the outlines that no leaf may come near."""
        return [self.outline(), *(solid(person).outline for person in self.people)]


def start_pose(plan: FloorPlan, model: RobotModel, start: str) -> Pose2D:
    """Return the pose of `dock`, a named start or place, or `x,y,theta`; raises StartError."""
    dock = plan.dock_of(model.series)
    if start == "dock" and dock is not None:
        return Pose2D(dock.x, dock.y, dock.theta)
    for place_ in (*plan.starts, *plan.places):
        if place_.name == start:
            return Pose2D(place_.x, place_.y, place_.theta)
    try:
        x, y, theta = (float(part) for part in start.split(","))
    except ValueError as error:
        raise StartError(
            f"{model.series} cannot start at {start!r}: give a dock, a named place or x,y,theta"
        ) from error
    if not all(map(math.isfinite, (x, y, theta))) or plan.room_at(x, y) is None:
        raise StartError(f"the start {start!r} is not in a room")
    return Pose2D(x, y, wrap_angle(theta))
