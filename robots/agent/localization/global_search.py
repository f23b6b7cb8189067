"""Searches the whole map for places where a scan fits, in slices so that no update waits.

Coarse: a raster of poses over all free space, each judged by a few beams on a likelihood field so
wide that the true pose cannot fall through the raster. Fine: the best, each from another spot, are
matched to the map and judged thoroughly, with what lies between robot and wall. The result are all
poses that explain the scan nearly as well as the best one, because rooms look alike.
"""

import math
from collections.abc import Generator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from robots.agent.localization.field import DistanceField
from robots.agent.localization.particle_filter import is_near
from robots.agent.localization.scan_matching import Matching, refine
from robots.agent.localization.sensor_model import (
    LikelihoodField,
    SensorModel,
    Sweep,
    agreement,
    likelihood_field,
)
from robots.world.sensing import Floats


@dataclass(frozen=True)
class Searching:
    """Settings of a search: first of the raster, then of the poses that are matched."""

    place: float = 0.25  # m between two places of the raster
    heading: float = math.radians(6.0)  # rad between two headings
    sigma: float = 0.25  # m, of the raster's likelihood
    beams: int = 40  # that a pose of the raster is judged by
    slice: int = 400_000  # beams looked up between two pauses
    finalists: int = 200  # poses that are matched
    batch: int = 25  # of them between two pauses
    judged: int = 80  # beams that they are judged by
    most: int = 60  # poses that are returned
    margin: float = 0.2  # below the best merit, within which they have to be


@dataclass(frozen=True, eq=False)
class Found:
    """Poses (n, 3) that explain a sweep, best first, with `Agreement.against_others` (n,)."""

    poses: Floats
    merit: Floats


Search = Generator[None, None, Found]
NOTHING = Found(np.zeros((0, 3)), np.zeros(0))
_WEAK = np.diag([1.0, 1.0, 10.0])  # a prior that only keeps an undetermined match in place
_MATCHING = Matching(scale=0.3, rounds=12)


class GlobalSearch:
    """Searches of one map."""

    def __init__(self, field: DistanceField, model: SensorModel, settings: Searching) -> None:
        self.field, self.model, self.settings = field, model, settings
        self.wide: LikelihoodField = likelihood_field(field, model, settings.sigma)
        self.places = _free_places(field, settings.place)

    def begin(self, sweep: Sweep) -> Search:
        """Return a search in slices, one for each `next()`; its StopIteration has the result."""
        if not len(sweep):
            return NOTHING
        coarse = yield from self._raster(sweep.thinned(self.settings.beams))
        finalists = _apart(coarse, self.places, self.settings)
        judged = sweep.thinned(self.settings.judged)
        matched: list[Floats] = []
        merits: list[Floats] = []
        for start in range(0, len(finalists), self.settings.batch):
            yield
            poses = finalists[start : start + self.settings.batch]
            poses = refine(self.field, poses, judged.points, _WEAK, _MATCHING)
            matched.append(poses)
            merits.append(self._merit(poses, judged))
        return _best(np.vstack(matched), np.concatenate(merits), self.settings)

    def _raster(self, sweep: Sweep) -> Generator[None, None, Floats]:
        """Return the log-likelihood (headings, places) of every pose of the raster."""
        headings = np.arange(0.0, 2.0 * math.pi, self.settings.heading)
        result = np.empty((len(headings), len(self.places)))
        at_once = max(1, self.settings.slice // len(sweep))
        done = 0
        for row, heading in enumerate(headings):
            for start in range(0, len(self.places), at_once):
                places = self.places[start : start + at_once]
                if done + len(places) > at_once:
                    yield
                    done = 0
                done += len(places)
                poses = np.column_stack([places, np.full(len(places), heading)])
                result[row, start : start + at_once] = self.wide.of(poses, sweep)
        return result

    def _merit(self, poses: Floats, sweep: Sweep) -> Floats:
        merit = agreement(self.field, self.model, poses, sweep).against_others
        merit[~self.field.is_free(poses[:, 0], poses[:, 1])] = -1.0
        return merit


def _free_places(field: DistanceField, spacing: float) -> Floats:
    rows, columns = field.signed.shape
    wide, high = columns * field.resolution, rows * field.resolution
    x, y = np.meshgrid(np.arange(spacing / 2, wide, spacing), np.arange(spacing / 2, high, spacing))
    free = field.is_free(x, y) & (field.signed[field.cells(x, y)] > spacing / 2)
    places = np.column_stack([x[free], y[free]])
    if len(places):
        return places
    row, column = np.nonzero(field.free)
    return (np.column_stack([column, row]).astype(np.float64) + 0.5) * field.resolution


def _apart(coarse: Floats, places: Floats, settings: Searching) -> Floats:
    """Return (n, 3) the best poses, best first, one from each block of the raster, which is two
    places wide and three headings deep.
    """
    block = np.floor(places / (2.0 * settings.place)).astype(np.int64) @ np.array([1, 1 << 20])
    blocks = block[None, :] + (np.arange(len(coarse), dtype=np.int64)[:, None] // 3 << 40)
    order = np.argsort(coarse, axis=None)[::-1]
    _, first = np.unique(blocks.ravel()[order], return_index=True)
    rows, columns = np.unravel_index(order[np.sort(first)[: settings.finalists]], coarse.shape)
    return np.column_stack([places[columns], rows * settings.heading])


def _thinned(poses: Floats, place: float, heading: float, most: int) -> npt.NDArray[np.intp]:
    """Return the indices of poses (n, 3), best first, without those near a better one."""
    open_ = np.ones(len(poses), dtype=np.bool_)
    chosen: list[int] = []
    for number in range(len(poses)):
        if not open_[number]:
            continue
        chosen.append(number)
        if len(chosen) == most:
            break
        open_ &= ~is_near(poses, poses[number], place, heading)
    return np.array(chosen, dtype=np.intp)


def _best(poses: Floats, merits: Floats, settings: Searching) -> Found:
    order = np.argsort(merits)[::-1]
    order = order[merits[order] >= merits[order[0]] - settings.margin]
    chosen = order[_thinned(poses[order], 0.3, math.radians(15.0), settings.most)]
    return Found(poses[chosen], merits[chosen])
