"""Inputs and outputs of a step of navigation."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from robots.agent.ramp import ZERO
from robots.agent.safety.collision.braking import Hazards
from robots.api.geometry import Pose2D
from robots.api.messages import Velocity
from robots.world.sensing import Floats, LaserScan

Status = Literal["RUNNING", "FINISHED", "FAILED"]
NOWHERE: Floats = np.zeros((0, 2))


@dataclass(frozen=True, eq=False)
class Sense:
    """One moment: `pose` on the map, `odometry`; `beams` were taken at odometry `beams_from`."""

    now: float
    pose: Pose2D
    odometry: Pose2D
    velocity: Velocity
    hazards: Hazards
    beams: LaserScan
    beams_from: Pose2D
    charger_contact: bool


@dataclass(frozen=True, eq=False)
class NavigationStep:
    """What to do now, and the state of the task.

    `velocity` is for the base, None once the robot is at rest; `reason` (robots/api/reasons.py) is
    also what a running task waits for; `path` (n, 2) is the route ahead in map metres; `progress`
    is from 0 to 1.
    """

    velocity: Velocity | None
    status: Status
    reason: str = ""
    path: Floats = field(default_factory=lambda: NOWHERE)
    progress: float = 0.0


def failed(reason: str) -> NavigationStep:
    """Return the end, at rest, of a task that could not be done."""
    return NavigationStep(ZERO, "FAILED", reason)


def finished(reason: str = "") -> NavigationStep:
    """Return the end, at rest, of a task that was done."""
    return NavigationStep(ZERO, "FINISHED", reason, progress=1.0)
