"""Moves poses so that the beams' ends fall onto the map's surfaces: Gauss-Newton on the signed
distance, many poses at once.

The residual of a beam is the distance from its end to the nearest surface; ends far from every
surface hardly count (Geman-McClure weights), so that people and chairs do not bend the fit. A prior
keeps a pose where the laser shows nothing, such as along a bare corridor.
"""

from dataclasses import dataclass

import numpy as np

from robots.agent.localization.field import DistanceField
from robots.agent.localization.sensor_model import placed
from robots.world.sensing import Floats


@dataclass(frozen=True)
class Matching:
    noise: float = 0.04  # m, of the end of a beam
    scale: float = 0.15  # m from a surface, from which on a beam loses its say
    beams: float = 25.0  # that a sweep is worth
    rounds: int = 6  # at most
    settled: float = 1e-3  # m, or rad: a smaller step needs no further round


def refine(
    field: DistanceField, poses: Floats, points: Floats, prior: Floats, settings: Matching
) -> Floats:
    """Return poses (n, 3) moved onto the map by points (k, 2), ends of beams in the robot's frame,
    metres. `prior` (3, 3) is the information (inverse covariance) of every pose before the scan.
    """
    if not len(points):
        return poses
    found: Floats = poses.copy()
    certainty = min(settings.beams / len(points), 1.0) / settings.noise**2
    for _ in range(settings.rounds):
        step = _step(field, poses, found, points, prior, certainty, settings.scale)
        found += step
        if np.abs(step).max() < settings.settled:
            break
    return found


def _step(
    field: DistanceField,
    start: Floats,
    poses: Floats,
    points: Floats,
    prior: Floats,
    certainty: float,
    scale: float,
) -> Floats:
    x, y = placed(points, poses)
    distance, slope_x, slope_y = field.distances(x, y)
    turning = slope_y * (x - poses[:, :1]) - slope_x * (y - poses[:, 1:2])
    slopes = np.stack([slope_x, slope_y, turning], axis=2)
    weighted = slopes * (certainty / (1.0 + (distance / scale) ** 2) ** 2)[:, :, None]
    information = weighted.transpose(0, 2, 1) @ slopes + prior
    pull = (weighted.transpose(0, 2, 1) @ distance[:, :, None])[:, :, 0] + (poses - start) @ prior
    return np.asarray(-np.linalg.solve(information, pull[:, :, None])[:, :, 0], dtype=np.float64)
