"""The rays of one eye against upright faces: which ray meets which face, how far away, and where
along it.

Every face is cast only with the rays between its two ends, and all of these pairs form one long
row.
"""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from robots.simulator.render.lens import RAYS, Lens
from robots.world.solids import Floats

FAR = 1e6  # metres: nothing there
EDGE = 1e-6

Distances = npt.NDArray[np.float32]
Places = npt.NDArray[np.intp]
Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Eye:
    """The viewpoint: `origin` (2,), and `world_from_level` (2, 2), whose columns are forward and
    left.

    Behind a mirror it is a reflection, and `beyond` (RAYS,) is how far each ray goes before it
    comes out of the glass.
    """

    origin: Floats
    world_from_level: Floats
    height: float
    beyond: Floats | None = None

    def directions(self, lens: Lens) -> Floats:
        """Return the unit direction (RAYS, 2) of every azimuth in the world."""
        directions: Floats = lens.directions @ self.world_from_level.T
        return directions

    def level(self, points: Floats) -> Floats:
        """Return world points (n, 2) as (forward, left)."""
        seen: Floats = (points - self.origin) @ self.world_from_level
        return seen

    def rays(self) -> tuple[int, int]:
        """Return first and last + 1 ray that matter: those at the mirror, if any."""
        if self.beyond is None:
            return 0, RAYS
        met = (self.beyond < FAR).nonzero()[0]
        return int(met[0]), int(met[-1]) + 1


class Meetings(NamedTuple):
    """Pairs of a face and a ray (m,): `row` of the face, `ray`, how far away `reach`, which `share`
    of the face's length from its start.

    `across` is the sine of the angle between them times the length of the face; `met` tells whether
    they meet at all.
    """

    row: Places
    ray: Places
    reach: Floats
    share: Floats
    across: Floats
    met: Mask

    def split(self, faces: int) -> tuple["Meetings", "Meetings"]:
        """Return the meetings with the first `faces`, and the others, rows from 0 again."""
        at = int(np.searchsorted(self.row, faces))
        parts: tuple[Any, ...] = self
        first = Meetings(*(part[:at] for part in parts))
        others = Meetings(*(part[at:] for part in parts))
        return first, others._replace(row=others.row - faces)


def angles(points: Floats) -> Floats:
    """Return the azimuths of (n, 2) forward, left."""
    found: Floats = np.arctan2(points[:, 1], points[:, 0])
    return found


def spans(lens: Lens, one: Floats, other: Floats, rays: tuple[int, int]) -> tuple[Places, Places]:
    """Return first and last + 1 ray (n,) between azimuths; all `rays` across the back."""
    low, high = np.minimum(one, other), np.maximum(one, other)
    first = np.floor((low - lens.azimuths[0]) / lens.step)
    last = np.ceil((high - lens.azimuths[0]) / lens.step) + 1.0
    around = high - low > math.pi
    first[around], last[around] = rays
    begin = np.minimum(np.maximum(first, rays[0]), rays[1]).astype(np.intp)
    return begin, np.maximum(np.minimum(last, rays[1]).astype(np.intp), begin)


def cast(faces: Floats, first: Places, last: Places, eye: Eye, directions: Floats) -> Meetings:
    """Cast rays first … last - 1 (n,) at faces (n, 4); along a face they divide by zero."""
    count = last - first
    ends = np.cumsum(count)
    total = int(ends[-1]) if len(ends) else 0
    row = np.repeat(np.arange(len(faces)), count)
    ray = np.arange(total) - np.repeat(ends - count - first, count)
    ahead, along = faces[:, :2] - eye.origin, faces[:, 2:] - faces[:, :2]
    cross = ahead[:, 0] * along[:, 1] - ahead[:, 1] * along[:, 0]
    cosine, sine = directions[:, 0][ray], directions[:, 1][ray]
    across = cosine * along[:, 1][row] - sine * along[:, 0][row]
    inverse = 1.0 / across
    reach = cross[row] * inverse
    share = (sine * ahead[:, 0][row] - cosine * ahead[:, 1][row]) * inverse
    nearest = 0.0 if eye.beyond is None else eye.beyond[ray]
    met = (reach > nearest) & (np.abs(share - 0.5) <= 0.5 + EDGE)
    return Meetings(row, ray, reach, share, across, met)


def looks_at(faces: Floats, origin: Floats) -> Mask:
    """Tell which faces (n, 4) turn their front to a point: their start is then at its left."""
    ahead, along = faces[:, :2] - origin, faces[:, 2:] - faces[:, :2]
    looks: Mask = ahead[:, 0] * along[:, 1] - ahead[:, 1] * along[:, 0] < 0.0
    return looks
