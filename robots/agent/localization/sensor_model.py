"""How well a scan fits the map: fast for many poses, thorough for a few.

Fast: the likelihood field (Thrun, Burgard, Fox: Probabilistic Robotics, section 6.4) judges the
distance of each beam's end from the nearest mapped surface. People, chairs and open doors are not
on the map; a beam that ends on one has a fixed cost at any distance.

Thorough: a beam that ends shorter than the map predicts met something new, which happens; a beam
that went through a wall of the map shows that the robot is not there. Only this tells the true pose
from one that merely has walls all around.
"""

from dataclasses import dataclass, replace

import numpy as np

from robots.agent.localization.field import DistanceField
from robots.world.sensing import Floats, LaserScan


@dataclass(frozen=True)
class MeritParams:
    """Weights of beams in the merit of a pose."""

    hidden: float = 0.8  # of a beam that falls short, which is left out of the account
    through: float = 3.0  # beams that fit weigh as much as one that went through a wall


MERIT = MeritParams()


@dataclass(frozen=True)
class SensorModel:
    """Likelihood of beams; errors correlate: a scan counts as `log_likelihood_scale` beams."""

    sigma: float = 0.1  # m by which a beam may miss a surface
    floor: float = 0.05  # price of a beam that fits nothing, as a share of one that fits
    log_likelihood_scale: float = 12.0  # beams
    near: float = 0.12  # m from a surface, within which a beam fits
    through: float = 0.3  # m before its end, from which a beam has gone through a surface


@dataclass(frozen=True, eq=False)
class Sweep:
    """Beams in the robot's frame: ends `points` (k, 2), origin `x`, `y`, `angles`, `ranges`."""

    points: Floats
    x: float
    y: float
    angles: Floats
    ranges: Floats
    reach: float

    def __len__(self) -> int:
        return len(self.ranges)

    def thinned(self, count: int) -> "Sweep":
        """Return about `count` of the beams, uniform."""
        if len(self) <= count:
            return self
        some = np.arange(count) * (len(self) - 1) // max(count - 1, 1)
        points, angles, ranges = self.points[some], self.angles[some], self.ranges[some]
        return replace(self, points=points, angles=angles, ranges=ranges)


def sweep_of(beams: LaserScan, shortest: float) -> Sweep:
    """Return beams beyond `shortest` metres; nearer ones meet the robot itself or a hand."""
    met = np.isfinite(beams.ranges)
    far = beams.ranges[met] >= shortest
    return Sweep(
        beams.points()[far],
        beams.mount.x,
        beams.mount.y,
        beams.angles[met][far] + beams.mount.theta,
        beams.ranges[met][far],
        beams.range_max,
    )


def placed(points: Floats, poses: Floats) -> tuple[Floats, Floats]:
    """Return x and y (n, k) of points (k, 2) in the robot's frame, placed by poses (n, 3)."""
    cosine, sine = np.cos(poses[:, 2])[:, None], np.sin(poses[:, 2])[:, None]
    spots = points.T
    x = np.concatenate([cosine, -sine], axis=1) @ spots
    y = np.concatenate([sine, cosine], axis=1) @ spots
    x += poses[:, :1]
    y += poses[:, 1:2]
    return x, y


@dataclass(frozen=True, eq=False)
class LikelihoodField:
    """The log-likelihood (h, w) of a beam that ends in a cell of the field."""

    field: DistanceField
    model: SensorModel
    table: Floats

    def of(self, poses: Floats, sweep: Sweep) -> Floats:
        """Return a sweep's log-likelihood (n,) at poses (n, 3); zero is a perfect fit."""
        if not len(sweep):
            return np.zeros(len(poses))
        found = self.field.look_up(self.table, *placed(sweep.points, poses))
        scale = min(self.model.log_likelihood_scale, len(sweep)) / len(sweep)
        return np.asarray(found.sum(axis=1) * scale, dtype=np.float64)


def likelihood_field(
    field: DistanceField, model: SensorModel, sigma: float | None = None
) -> LikelihoodField:
    """Return the table of a map, with another `sigma` than the model's when given."""
    normal = np.exp(-0.5 * (field.signed / (sigma or model.sigma)) ** 2)
    return LikelihoodField(field, model, np.log(model.floor + (1.0 - model.floor) * normal))


@dataclass(frozen=True)
class Agreement:
    """Shares of beams, together one: fit the map, are `short` of it, or go `through` a wall."""

    fits: Floats
    short: Floats
    through: Floats

    @property
    def merit(self) -> Floats:
        """The fit of the pose to the scan, from -1 to 1; blocked beams count for little.

        Measured in the office among four and eight people: at the true pose 99 of 100 scans have
        more than 0.73, at wrong poses that were matched to the map 5 of 100 have more than 0.37.
        """
        return self._explains(1.0)

    @property
    def against_others(self) -> Floats:
        """The merit for a choice between places, where a beam through a wall weighs more than one
        that fits: at the true pose there are hardly any, and nothing else excludes a corner that
        looks like the robot's own where an open door hides the rest. Not for trusting a pose at
        all: before a mirror many beams go through its wall.
        """
        return self._explains(MERIT.through)

    def _explains(self, through: float) -> Floats:
        merit: Floats = (self.fits - through * self.through) / (1.0 - MERIT.hidden * self.short)
        return merit


def agreement(field: DistanceField, model: SensorModel, poses: Floats, sweep: Sweep) -> Agreement:
    """Return the shares of a scan's beams, each (n,), at poses (n, 3)."""
    if not len(sweep):
        nothing = np.zeros(len(poses))
        return Agreement(nothing, nothing + 1.0, nothing)
    x, y = placed(sweep.points, poses)
    origin_x, origin_y = placed(np.array([[sweep.x, sweep.y]]), poses)
    clear = sweep.ranges - model.through
    through = field.cast(origin_x, origin_y, sweep.angles + poses[:, 2:], clear) < clear
    fits = (np.abs(field.distances(x, y)[0]) < model.near) & ~through
    share_fits, share_through = fits.sum(axis=1) / len(sweep), through.sum(axis=1) / len(sweep)
    return Agreement(share_fits, 1.0 - share_fits - share_through, share_through)
