"""Distance sensors: a planar laser scanner, and a sonar, which measures the distance of the nearest
thing in its cone that reflects the sound.
"""

import math

import numpy as np

from robots.api.geometry import Pose2D
from robots.world.raycaster import cast, sweep
from robots.world.robot_models import LaserModel, SonarModel
from robots.world.solids import Floats

SONAR_RAYS = 13  # of a cone


def scan(segments: Floats, pose: Pose2D, model: LaserModel, rng: np.random.Generator) -> Floats:
    """Return ranges (beams,) in metres from `model.angle_min` on, counter-clockwise; `inf` without
    an echo.

    `segments` (n, 4) are the sides of solids at the height of the laser, counter-clockwise
    about each; `pose` is the robot's.
    """
    mount = pose.compose(model.mount)
    start = mount.theta + model.angle_min
    ranges = sweep(segments, mount.x, mount.y, start, model.angle_increment, model.beams)
    ranges = np.maximum(ranges + rng.normal(0.0, model.noise, model.beams), 0.0)
    lost = (ranges > model.range_max) | (rng.random(model.beams) < model.dropout)
    ranges[lost] = math.inf
    return ranges


def echo(segments: Floats, mount: Pose2D, model: SonarModel, rng: np.random.Generator) -> float:
    """Return the distance in metres that a sonar at `mount` in the world measures, `inf` without an
    echo. `segments` (n, 4) are the sides of solids at its height.
    """
    angles = mount.theta + np.linspace(-model.width / 2.0, model.width / 2.0, SONAR_RAYS)
    ranges, met = cast(segments, mount.x, mount.y, angles)
    noise, lost = model.noise * rng.standard_normal(), rng.random() < model.dropout
    hits = np.flatnonzero(ranges <= model.farthest)
    if lost or len(hits) == 0:
        return math.inf
    start, end = segments[met[hits], :2], segments[met[hits], 2:]
    direction = np.column_stack([np.cos(angles[hits]), np.sin(angles[hits])])
    spot = direction * ranges[hits, None] + (mount.x, mount.y)
    along = (end - start) / np.linalg.norm(end - start, axis=1)[:, None]
    off_normal = np.arcsin(np.minimum(np.abs((direction * along).sum(axis=1)), 1.0))
    to_edge = np.minimum(np.linalg.norm(spot - start, axis=1), np.linalg.norm(spot - end, axis=1))
    back = (off_normal <= model.slant) | (to_edge <= model.edge)
    if not back.any():
        return math.inf
    return float(max(ranges[hits][back].min() + noise, model.nearest))
