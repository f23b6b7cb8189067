"""A planar laser scanner."""

import math

import numpy as np

from robots.agent.simulator.profiles import LaserModel
from robots.api.geometry import Pose2D
from robots.world.raycaster import sweep
from robots.world.solids import Floats


def scan(segments: Floats, pose: Pose2D, model: LaserModel, rng: np.random.Generator) -> Floats:
    """Return ranges (beams,) in metres from `model.angle_min` on, counter-clockwise; `inf` where
    nothing came back.

    `segments` (n, 4) are the sides of what stands at the height of the laser, counter-clockwise
    about each; `pose` is the robot's.
    """
    mount = pose.compose(model.mount)
    ranges = sweep(
        segments,
        mount.x,
        mount.y,
        mount.theta + model.angle_min,
        model.angle_increment,
        model.beams,
    )
    ranges = np.maximum(ranges + rng.normal(0.0, model.noise, model.beams), 0.0)
    lost = (ranges > model.range_max) | (rng.random(model.beams) < model.dropout)
    ranges[lost] = math.inf
    return ranges
