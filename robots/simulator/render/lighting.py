"""Light that is painted into the textures once: warm lamps at the ceiling, cool ambient light, dark
corners.

A lamp gives cos(incidence) / (distance² + c) of its strength to surfaces that face it in its
room; shadows of furniture are soft stains on the floor. Textures are multiplied in display values,
so a light L counts as L to the power of 1 / 2.2.
"""

import itertools
import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from robots.api.floorplan import FloorPlan, Room, contains
from robots.simulator.render.materials import Picture, Plane
from robots.world.solids import Floats

SPACING = 2.6  # metres between lamps
DROP = 0.12
LAMP = np.array([1.0, 0.93, 0.82])
AMBIENT = np.array([0.34, 0.355, 0.375])
STRENGTH = 2.1
SOFTNESS = 1.2
DISPLAY = 1.0 / 2.2
COARSE = 0.1  # metres between computed points
HALF = 3  # texels of a floor between distances to solids


@dataclass(frozen=True, eq=False)
class Lights:
    """The lamps (n, 3) of every room, by its name."""

    plan: FloorPlan
    lamps: dict[str, Floats]

    def at(self, points: Floats, normals: Floats, room: str | None) -> Floats:
        """Return the factor (…, 3) for texels at points (…, 3) with normals (…, 3)."""
        light = np.broadcast_to(AMBIENT, points.shape).copy()
        for lamp in self.lamps.get(room or "", np.zeros((0, 3))):
            towards = lamp - points
            squared = (towards**2).sum(axis=-1)
            facing = np.clip((towards * normals).sum(axis=-1) / np.sqrt(squared), 0.0, 1.0)
            light += (STRENGTH * facing / (squared + SOFTNESS))[..., None] * LAMP
        factor: Floats = np.clip(light, 0.0, 1.6) ** DISPLAY
        return factor

    def room_of(self, x: float, y: float) -> str | None:
        """Return the room whose lamps light a point, also for one in a doorway."""
        for dx, dy in ((0.0, 0.0), (0.2, 0.0), (-0.2, 0.0), (0.0, 0.2), (0.0, -0.2)):
            room = self.plan.room_at(x + dx, y + dy)
            if room is not None:
                return room.name
        return None


def hang(plan: FloorPlan) -> Lights:
    """Return lamps, evenly over every room."""
    return Lights(plan, {room.name: _lamps(room, plan.ceiling) for room in plan.rooms})


def _lamps(room: Room, ceiling: float) -> Floats:
    polygon = np.array(room.polygon)
    low, high = polygon.min(axis=0), polygon.max(axis=0)
    counts = [max(1, round((b - a) / SPACING)) for a, b in zip(low, high, strict=True)]
    across, up = (
        low[axis] + (np.arange(counts[axis]) + 0.5) * (high[axis] - low[axis]) / counts[axis]
        for axis in (0, 1)
    )
    found = [
        (x, y, ceiling - DROP)
        for x, y in itertools.product(across.tolist(), up.tolist())
        if contains(room.polygon, x, y)
    ]
    return np.array(found).reshape(-1, 3)


def light_wall(
    picture: Picture,
    lights: Lights,
    start: Floats,
    end: Floats,
    *,
    bottom: float,
    top: float,
    corners: bool,
) -> None:
    """Light an upright picture (columns, rows, 3) in place, from `start` (left) to `end`."""
    length = math.dist(start, end)
    columns = max(2, math.ceil(length / COARSE) + 1)
    rows = max(2, math.ceil((top - bottom) / COARSE) + 1)
    share, height = np.linspace(0.0, 1.0, columns), np.linspace(bottom, top, rows)
    points = np.empty((columns, rows, 3))
    points[..., :2] = (start + share[:, None] * (end - start))[:, None, :]
    points[..., 2] = height
    normal = np.array([end[1] - start[1], start[0] - end[0], 0.0]) / length
    x, y = ((start + end) / 2.0 + 0.1 * normal[:2]).tolist()
    factor = lights.at(points, np.broadcast_to(normal, points.shape), lights.room_of(x, y))
    factor *= (1.0 - 0.22 * np.exp(-height / 0.12))[None, :, None]
    if corners:
        ends = [
            1.0 - 0.2 * np.exp(-away / 0.15) for away in (share * length, length - share * length)
        ]
        factor *= (ends[0] * ends[1])[:, None, None]
        factor *= (1.0 - 0.12 * np.exp(-(lights.plan.ceiling - height) / 0.15))[None, :, None]
    picture *= enlarge(factor, (picture.shape[0], picture.shape[1]))


def light_floor(
    picture: Picture,
    lights: Lights,
    x: Plane,
    y: Plane,
    *,
    solid: npt.NDArray[np.bool_],
    height: float,
    upwards: bool,
) -> None:
    """Light the floor or the ceiling (rows, columns, 3) of the whole site in place.

    `x` (columns,) and `y` (rows,) are the metres of its texels, `solid` (rows, columns) is True
    where it is occupied, `height` in metres; `upwards`: it is a floor, seen from above.
    """
    step = max(1, round(COARSE / float(x[1] - x[0])))
    coarse_x, coarse_y = x[::step], y[::step]
    points = np.empty((coarse_y.size, coarse_x.size, 3))
    points[..., 0], points[..., 1], points[..., 2] = coarse_x[None, :], coarse_y[:, None], height
    normals = np.broadcast_to(np.array([0.0, 0.0, 1.0 if upwards else -1.0]), points.shape)
    factor = np.broadcast_to(AMBIENT**DISPLAY, points.shape).copy()
    for room in lights.plan.rooms:
        polygon = np.array(room.polygon)
        rows = (coarse_y > polygon[:, 1].min() - 0.12) & (coarse_y < polygon[:, 1].max() + 0.12)
        columns = (coarse_x > polygon[:, 0].min() - 0.12) & (coarse_x < polygon[:, 0].max() + 0.12)
        block = np.ix_(rows, columns)
        factor[block] = lights.at(points[block], normals[block], room.name)
    distance = ndimage.distance_transform_edt(~solid[::HALF, ::HALF]) * float(x[1] - x[0]) * HALF
    shade = (1.0 - 0.42 * np.exp(-distance / 0.10))[..., None]
    for each in (factor, shade):
        picture *= enlarge(each, (picture.shape[0], picture.shape[1]))


def enlarge(factor: Floats, shape: tuple[int, int]) -> Picture:
    """Return (n, m, k) spread over `shape` texels, straight between the points."""
    a = np.linspace(0.0, factor.shape[0] - 1.001, shape[0])
    b = np.linspace(0.0, factor.shape[1] - 1.001, shape[1])
    i, j = a.astype(np.intp), b.astype(np.intp)
    s, t = (a - i)[:, None, None].astype(np.float32), (b - j)[None, :, None].astype(np.float32)
    small = factor.astype(np.float32)
    columns = small[:, j]
    columns += (small[:, np.minimum(j + 1, factor.shape[1] - 1)] - columns) * t
    spread: Picture = columns[i]
    spread += (columns[np.minimum(i + 1, factor.shape[0] - 1)] - spread) * s
    return spread
