"""How far to trust a pose, from 0 to 1; below one half the robot is lost."""

import math
from dataclasses import dataclass

from robots.agent.localization.sensor_model import Agreement
from robots.api.geometry import Pose2D


@dataclass(frozen=True)
class Scoring:
    """`even` is the merit of a pose that scores one half, `slope` how fast the score rises there; a
    search finds poses from `plausible` on.

    Of several places that a search found, one is believed when it held for `proof` metres of way.
    The score follows over `memory` seconds, so that somebody who walks past loses nobody. Without a
    sweep it falls to 1/e over `blind` metres beyond the first `granted`.
    """

    lost: float = 0.5
    even: float = 0.52
    slope: float = 14.0
    memory: float = 1.5
    granted: float = 0.3
    blind: float = 4.0
    plausible: float = 0.4
    proof: float = 1.0


def quality(judged: Agreement, scoring: Scoring) -> float:
    """Return what one sweep says about one pose, from 0 to 1."""
    return 1.0 / (1.0 + math.exp(-scoring.slope * (float(judged.merit[0]) - scoring.even)))


def decay(step: Pose2D, scoring: Scoring) -> float:
    """Return what is left of a score after a step on odometry alone."""
    return math.exp(-max(0.0, way_of(step) - scoring.granted) / scoring.blind)


def way_of(step: Pose2D) -> float:
    """Return the metres of a step, a turn counted too: a radian as much as half a metre."""
    return math.hypot(step.x, step.y) + 0.5 * abs(step.theta)
