"""Inputs and outputs of the navigation node."""

from dataclasses import dataclass, field

import numpy as np

from robots.agent.robot_interface import ActionProgress
from robots.api.geometry import Pose2D
from robots.api.messages import Limits, Point, Pose, Velocity
from robots.world.sensing import Covariance, Floats, LaserScan

NO_POINTS: Floats = np.zeros((0, 2))


@dataclass(frozen=True)
class Body:
    """A robot: `series` selects its docks, `localizes` means that it reports its own pose."""

    series: str
    footprint: tuple[Point, ...]
    limits: Limits
    localizes: bool = False


@dataclass(frozen=True, eq=False)
class SensorSnapshot:
    """One moment of a robot's own sensors.

    `stamp` is in seconds by the robot's clock, `odometry` in a frame of its own, `beams` the newest
    scan, `points` (n, 2) recent obstacles in the robot's frame, `pose` the reported one of a robot
    that localizes itself, on the map.
    """

    stamp: float
    odometry: Pose2D
    velocity: Velocity
    charger_contact: bool = False
    beams: LaserScan | None = None
    points: Floats = field(default_factory=lambda: NO_POINTS)
    pose: Pose | None = None


@dataclass(frozen=True)
class NavigationOutput:
    """The navigation node's answer to a snapshot.

    `pose` is on the map at `stamp`, when the odometry was `odometry`. `wanted` is None while no
    action moves the robot, `path` when unchanged. `news` are of actions.
    """

    stamp: float
    odometry: Pose2D
    pose: Pose2D
    covariance: Covariance
    score: float
    localized: bool
    wanted: Velocity | None = None
    news: tuple[ActionProgress, ...] = ()
    path: tuple[Point, ...] | None = None
