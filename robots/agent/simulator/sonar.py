"""A sonar: the nearest thing in its cone that sends the sound back."""

import math

import numpy as np

from robots.agent.simulator.profiles import SonarModel
from robots.api.geometry import Pose2D
from robots.world.raycaster import cast
from robots.world.solids import Floats

RAYS = 13


def echo(segments: Floats, mount: Pose2D, model: SonarModel, rng: np.random.Generator) -> float:
    """Return the distance in metres at which a sonar at `mount` in the world hears something, `inf`
    when it hears nothing.

    `segments` (n, 4) are the sides of what stands at its height.
    """
    angles = mount.theta + np.linspace(-model.width / 2.0, model.width / 2.0, RAYS)
    ranges, met = cast(segments, mount.x, mount.y, angles)
    noise, lost = model.noise * rng.standard_normal(), rng.random() < model.dropout
    hits = np.flatnonzero(ranges <= model.farthest)
    if lost or len(hits) == 0:
        return math.inf
    start, end = segments[met[hits], :2], segments[met[hits], 2:]
    way = np.column_stack([np.cos(angles[hits]), np.sin(angles[hits])])
    spot = way * ranges[hits, None] + (mount.x, mount.y)
    along = (end - start) / np.linalg.norm(end - start, axis=1)[:, None]
    off_normal = np.arcsin(np.minimum(np.abs((way * along).sum(axis=1)), 1.0))
    to_edge = np.minimum(np.linalg.norm(spot - start, axis=1), np.linalg.norm(spot - end, axis=1))
    back = (off_normal <= model.slant) | (to_edge <= model.edge)
    if not back.any():
        return math.inf
    return float(max(ranges[hits][back].min() + noise, model.nearest))
