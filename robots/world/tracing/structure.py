"""Which cells of a map are floor, building and furniture.

A laser looks through windows and past people, so free cells that no robot fits into are not floor
(the fans outside of a building). An island in the floor is furniture when it is small, and a part
of the building when it is large (a block of rooms that the robot did not enter, a stairwell).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from robots.world.solids import Floats
from robots.world.tracing.layers import EVERYWHERE, Bools, Labels, Layers


@dataclass(frozen=True)
class StructureParams:
    """Parameters of distinguishing floor and furniture from the building."""

    narrowest: float = 0.28  # metres from the middle of a robot to its side, at least
    speck: float = 0.12  # metres: the longer side of the leg of a chair
    largest_furniture: float = 3.0  # metres: the longer side; a larger island is building


STRUCTURE = StructureParams()


class TracingError(ValueError):
    """No plan can be traced from this map; the message is one sentence."""


@dataclass(frozen=True, eq=False)
class Structure:
    """Masks (h, w): `floor` where a robot can be or reach, `furniture` that is free-standing, its
    inside included, and `building`, the other occupied cells.
    """

    layers: Layers
    floor: Bools
    furniture: Bools
    building: Bools

    @property
    def ground(self) -> Bools:
        """The floor as it would be without free-standing furniture."""
        return self.floor | self.furniture

    @cached_property
    def floor_clearance(self) -> Floats:
        """Return (h, w) metres from each cell of the floor to where it ends."""
        return self.layers.clearance(self.floor)

    @cached_property
    def ground_clearance(self) -> Floats:
        """Return the same of the ground."""
        return self.layers.clearance(self.ground)


def structure_of(layers: Layers) -> Structure:
    """Tell floor, furniture and building apart.

    Raises:
        TracingError: there is no floor for a robot.
    """
    specks = _specks(layers)
    around = _floor(layers, layers.free | specks)
    islands, _ = scipy.ndimage.label(~around, EVERYWHERE)
    furniture = np.isin(islands, _small_islands(layers, islands)) | (specks & around)
    return Structure(layers, around & layers.free, furniture, layers.occupied & ~furniture)


def _specks(layers: Layers) -> Bools:
    """Return islands no larger than the leg of a chair: they divide no room."""
    groups, _ = scipy.ndimage.label(~layers.free, EVERYWHERE)
    longest = max(2, layers.cells_in(STRUCTURE.speck))
    sides = [_side(place) for place in scipy.ndimage.find_objects(groups)]
    specks: Bools = np.isin(groups, 1 + np.flatnonzero(np.array(sides) <= longest))
    return specks


def _side(place: tuple[slice, slice]) -> int:
    """Return the longer side of a group's bounding box in cells."""
    return max(int(each.stop - each.start) for each in place)


def _floor(layers: Layers, free: Bools) -> Bools:
    """Return the free cells within a robot's half width of where its middle can be, of the largest
    connected part (a reconstruction after an opening with a disc).
    """
    regions, count = scipy.ndimage.label(layers.clearance(free) >= STRUCTURE.narrowest)
    if not count:
        raise TracingError(
            "no free floor on the map is wide enough for a robot: check its thresholds"
        )
    largest = int(np.argmax(np.bincount(regions.ravel())[1:])) + 1
    away = scipy.ndimage.distance_transform_edt(regions != largest) * layers.resolution
    floor: Bools = free & (away <= STRUCTURE.narrowest + 0.75 * layers.resolution)
    return floor


def _small_islands(layers: Layers, islands: Labels) -> list[int]:
    """Return the labels of islands that are small and do not touch the edge of the map."""
    high, wide = islands.shape
    longest = STRUCTURE.largest_furniture / layers.resolution
    small = []
    for label, place in enumerate(scipy.ndimage.find_objects(islands), start=1):
        rows, columns = place
        at_edge = rows.start == 0 or columns.start == 0 or rows.stop == high or columns.stop == wide
        if not at_edge and _side(place) <= longest:
            small.append(label)
    return small
