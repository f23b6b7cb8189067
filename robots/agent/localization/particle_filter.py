"""Particles weighed by the laser (Thrun, Burgard, Fox, tables 8.3 and 8.4), as many as their spread
needs: KLD sampling draws more, the more cells of a coarse raster over x, y and heading they fill.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from robots.world.sensing import Floats

NORMAL_99 = 2.326  # upper quantile of the normal distribution at 0.99


@dataclass(frozen=True)
class Sampling:
    """Number of particles, by KLD sampling (Fox, "Adapting the Sample Size in Particle Filters
    Through KLD-Sampling", 2003).
    """

    fewest: int = 200  # particles
    most: int = 3000  # particles
    place: float = 0.25  # m of a bin
    heading: float = math.radians(10.0)  # rad of a bin
    error: float = 0.05  # that is granted, as a Kullback-Leibler distance


@dataclass(frozen=True, eq=False)
class ParticleSet:
    """Particles: `poses` (n, 3) x, y, theta and `weights` (n,) that sum to one."""

    poses: Floats
    weights: Floats

    def reweighted(self, log_likelihoods: Floats) -> "ParticleSet":
        """Return the same poses weighed by log-likelihoods (n,)."""
        weights = self.weights * np.exp(log_likelihoods - log_likelihoods.max())
        return ParticleSet(self.poses, weights / weights.sum())

    def is_depleted(self) -> bool:
        """Tell whether so few particles carry the weight that resampling is due."""
        return bool(1.0 / (self.weights**2).sum() < 0.5 * len(self.weights))

    def resampled(self, sampling: Sampling, rng: np.random.Generator) -> "ParticleSet":
        """Return particles of equal weight, by low variance sampling."""
        count = kld_count(self.poses[self.weights > 0.01 / len(self.weights)], sampling)
        comb = (rng.random() + np.arange(count)) / count
        chosen = np.minimum(np.searchsorted(np.cumsum(self.weights), comb), len(self.weights) - 1)
        return uniform(self.poses[chosen])


def uniform(poses: Floats) -> ParticleSet:
    return ParticleSet(poses, np.full(len(poses), 1.0 / len(poses)))


def scattered(
    poses: Floats,
    counts: npt.NDArray[np.intp],
    place: float,
    heading: float,
    rng: np.random.Generator,
) -> Floats:
    """Return (sum of counts, 3) poses, normal around (n, 3): `place` metres, `heading` radians."""
    errors = rng.standard_normal((int(counts.sum()), 3)) * (place, place, heading)
    return np.repeat(poses, counts, axis=0) + errors


def kld_count(poses: Floats, sampling: Sampling) -> int:
    """Return how many particles keep within `error`, with 99 % probability (Fox 2003)."""
    filled = int(groups(poses, sampling.place, sampling.heading).max(initial=0)) + 1
    if filled < 2:
        return sampling.fewest
    ninth = 2.0 / (9.0 * (filled - 1))
    quantile = (1.0 - ninth + math.sqrt(ninth) * NORMAL_99) ** 3
    count = (filled - 1) / (2.0 * sampling.error) * quantile
    return int(min(max(count, sampling.fewest), sampling.most))


@dataclass(frozen=True, eq=False)
class Cluster:
    """The particles of one place: `mean` (3,), `covariance` (3, 3), `share` of the weight."""

    mean: Floats
    covariance: Floats
    share: float


def groups(poses: Floats, reach: float, turn: float) -> npt.NDArray[np.intp]:
    """Return the raster cell (n,) of poses (n, 3), `reach` metres wide, `turn` radians deep."""
    raster = np.floor(poses / (reach, reach, turn)).astype(np.int64)
    raster[:, 2] %= round(2.0 * math.pi / turn)
    _, owner = np.unique(raster @ np.array([1, 1 << 20, 1 << 40]), return_inverse=True)
    return owner


def places(
    poses: Floats, fits: Floats, reach: float, turn: float
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Return the place (n,) of each of the poses (n, 3), and (k,) the pose that fits each place
    best.

    The best remaining pose by `fits` (n,) is the middle of the next place, which extends for
    `reach` metres and `turn` radians.
    """
    owner, best = np.full(len(poses), -1, dtype=np.intp), list[int]()
    left = np.argsort(-fits)
    while len(left):
        near = is_near(poses[left], poses[left[0]], reach, turn)
        near[0] = True  # NaN is near nothing
        owner[left[near]] = len(best)
        best.append(int(left[0]))
        left = left[~near]
    return owner, np.array(best, dtype=np.intp)


def heaviest_cluster(particles: ParticleSet, reach: float, turn: float) -> Cluster:
    """Return the heaviest cluster: within `reach` metres and `turn` radians of the densest."""
    owner = groups(particles.poses, reach, turn)
    centre = moments(particles, owner == np.argmax(np.bincount(owner, particles.weights)))
    for _ in range(2):
        near = is_near(particles.poses, centre.mean, reach, turn)
        centre = moments(particles, near) if near.any() else centre
    return centre


def is_near(poses: Floats, pose: Floats, reach: float, turn: float) -> npt.NDArray[np.bool_]:
    """Tell which poses (n, 3) are within `reach` metres and `turn` radians of a pose (3,)."""
    offset = poses - pose
    turned = np.abs(wrapped(offset[:, 2]))
    near: npt.NDArray[np.bool_] = (np.hypot(offset[:, 0], offset[:, 1]) < reach) & (turned < turn)
    return near


def moments(particles: ParticleSet, chosen: npt.NDArray[np.bool_]) -> Cluster:
    """Return the chosen particles' mean and covariance; headings average on the circle."""
    poses, weights = particles.poses[chosen], particles.weights[chosen]
    share = float(weights.sum())
    weights = weights / share if share > 0.0 else np.full(len(weights), 1.0 / len(weights))
    heading = math.atan2(float(weights @ np.sin(poses[:, 2])), float(weights @ np.cos(poses[:, 2])))
    mean = np.array([float(weights @ poses[:, 0]), float(weights @ poses[:, 1]), heading])
    offset = poses - mean
    offset[:, 2] = wrapped(offset[:, 2])
    return Cluster(mean, (offset * weights[:, None]).T @ offset, share)


def wrapped(angles: Floats) -> Floats:
    """Return the same directions in [-pi, pi)."""
    return (angles + math.pi) % (2.0 * math.pi) - math.pi
