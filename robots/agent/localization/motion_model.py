"""Errors of odometry (Thrun, Burgard, Fox: Probabilistic Robotics, table 5.6: turn, drive straight,
turn, each with an error).

Two changes: only the errors of the odometry's step are drawn, so that creeping and reversing need
no angle of a step near zero; and variances grow with the distance, not with its square, so that the
spread does not depend on the number of updates.
"""

import math
from dataclasses import dataclass

import numpy as np

from robots.api.geometry import Pose2D
from robots.world.sensing import Floats


@dataclass(frozen=True)
class MotionNoise:
    """Variances per radian turned and per metre driven, of a turn and of a distance."""

    turn_by_turn: float = 0.0016
    turn_by_distance: float = 0.0012
    distance_by_distance: float = 0.0012
    distance_by_turn: float = 0.0001


def move(poses: Floats, step: Pose2D, noise: MotionNoise, rng: np.random.Generator) -> Floats:
    """Return poses (n, 3) x, y, theta after an odometry step, each with its own error."""
    metres, turn = math.hypot(step.x, step.y), abs(step.theta)
    draws = rng.standard_normal((4, len(poses)))
    turned = math.sqrt((noise.turn_by_turn * turn + noise.turn_by_distance * metres) / 2.0)
    slid = math.sqrt(noise.distance_by_distance * metres + noise.distance_by_turn * turn)
    heading = poses[:, 2] + turned * draws[0]
    along, aside = step.x + slid * draws[1], step.y + slid / 3.0 * draws[2]
    cosine, sine = np.cos(heading), np.sin(heading)
    x = poses[:, 0] + cosine * along - sine * aside
    y = poses[:, 1] + sine * along + cosine * aside
    return np.column_stack([x, y, heading + step.theta + turned * draws[3]])
