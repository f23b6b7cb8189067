"""How far to trust a pose, from 0 to 1; below one half the robot is lost."""

import math
from dataclasses import dataclass

from robots.agent.localization.sensor_model import Agreement
from robots.api.geometry import Pose2D


@dataclass(frozen=True)
class Scoring:
    """How the merit of a pose becomes a score."""

    lost: float = 0.5  # score below which the robot is lost
    even: float = 0.52  # merit of a pose that scores one half
    slope: float = 14.0  # how fast the score rises there
    memory: float = 1.5  # s over which the score follows: somebody who walks past loses nobody
    granted: float = 0.3  # m without a sweep for which the score holds
    blind: float = 4.0  # m after that, over which it falls to 1/e
    plausible: float = 0.4  # merit from which a search takes a pose
    proof: float = 1.0  # m for which one of several places has to hold until it is believed


def quality(judged: Agreement, scoring: Scoring) -> float:
    """Return what one sweep says about one pose, from 0 to 1."""
    return 1.0 / (1.0 + math.exp(-scoring.slope * (float(judged.merit[0]) - scoring.even)))


def decay(step: Pose2D, scoring: Scoring) -> float:
    """Return what is left of a score after a step on odometry alone."""
    return math.exp(-max(0.0, way_of(step) - scoring.granted) / scoring.blind)


def way_of(step: Pose2D) -> float:
    """Return the metres of a step, a turn counted too: a radian as much as half a metre."""
    return math.hypot(step.x, step.y) + 0.5 * abs(step.theta)
