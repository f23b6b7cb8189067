"""Maps drawn as text, and what a laser sees in them: `#` stands, `.` is free, a blank is unknown,
`~` stands but is not on the map.
"""

import math

import numpy as np

from robots.api.geometry import MapTransform, Pose2D
from robots.world.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from robots.world.raycaster import cast
from robots.world.sensing import CENTRE, LaserScan
from robots.world.solids import Floats, Solid as _Solid, edges, rectangle

SHADES = {"#": OCCUPIED, ".": FREE, "~": FREE, " ": UNKNOWN}


def drawn_map(
    picture: str, resolution: float = 0.05, scale: int = 1, origin: Pose2D = CENTRE
) -> OccupancyGrid:
    """Return the map of a picture, each character `scale` by `scale` cells of `resolution` metres,
    its lower left corner at `origin`.
    """
    lines = _lines(picture)
    image = np.array([[SHADES[character] for character in line] for line in lines], dtype=np.uint8)
    image = np.kron(image, np.ones((scale, scale), dtype=np.uint8))
    return OccupancyGrid(image, MapTransform(resolution, origin, image.shape[0]))


def standing(picture: str, cell: float, origin: Pose2D = CENTRE) -> Floats:
    """Return the sides (n, 4) in the world of everything that stands in a picture of `cell` metres
    a character.
    """
    lines = _lines(picture)
    solids = []
    for row, line in enumerate(lines):
        for column, character in enumerate(line):
            if character in "#~":
                centre = origin.compose(
                    Pose2D((column + 0.5) * cell, (len(lines) - row - 0.5) * cell, 0.0)
                )
                solids.append(_Solid("wall", "", rectangle(centre, cell, cell), 1.0))
    return edges(tuple(solids))


def beams_from(
    sides: Floats,
    pose: Pose2D,
    *,
    stamp: float = 0.0,
    count: int = 181,
    reach: float = 10.0,
    mount: Pose2D = CENTRE,
) -> LaserScan:
    """Return what a laser of 240 degrees on a robot at `pose` sees, without noise."""
    first, each = math.radians(-120.0), math.radians(240.0) / (count - 1)
    eye = pose.compose(mount)
    ranges, _ = cast(sides, eye.x, eye.y, eye.theta + first + each * np.arange(count))
    return LaserScan(stamp, first, each, reach, ranges, mount)


def _lines(picture: str) -> list[str]:
    lines = [line for line in picture.splitlines() if line.strip()]
    width = max(len(line) for line in lines)
    return [line.ljust(width) for line in lines]
