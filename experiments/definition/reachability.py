"""Which places of a site a robot can reach with some doors closed. A closed door is a wall of the
plan, and the map is that of the site's inspection.
"""

from collections.abc import Iterable, Sequence
from functools import lru_cache

import msgspec

from robots.api.floorplan import FloorPlan, Wall
from robots.api.geometry import Pose2D
from robots.api.messages import Point
from robots.world.inspection import BACKED_OUT, Floor
from robots.world.render_plan import rasterise

CELLS = 2.0  # the distance of free floor from the point before a station


def unreachable(
    plan: FloorPlan, closed: Iterable[str], dock: Pose2D, spots: Sequence[tuple[Point, float]]
) -> list[int]:
    """Return the indices of the spots, each a point and a radius in metres, that a robot cannot
    reach from `dock`; all of them when it cannot leave the station.
    """
    floor = _floor(plan, frozenset(closed))
    x, y = dock.apply(-BACKED_OUT, 0.0)
    home = floor.about(x, y, CELLS * floor.grid.transform.resolution)[1]
    return [
        n
        for n, ((x, y), radius) in enumerate(spots)
        if not home & floor.about(x, y, radius / 2.0)[1]
    ]


@lru_cache(maxsize=16)
def _floor(plan: FloorPlan, closed: frozenset[str]) -> Floor:
    leaves = tuple(
        Wall(start=door.start, end=door.end, thickness=door.thickness)
        for door in plan.doors
        if door.name in closed
    )
    return Floor.of(rasterise(msgspec.structs.replace(plan, walls=(*plan.walls, *leaves))))
