"""The camera's geometry: for every pixel its direction, in the two numbers that a world of upright
faces needs.

A ray of a pinhole camera, pitched down by p, goes through pixel (u, v) as (1, u', v') with u' = (u
+ 0.5 - w / 2) / f to the right and v' = (v + 0.5 - h / 2) / f down. In the robot's level frame that
is forward cos p - v' sin p, left -u', up
-sin p - v' cos p: exact, nothing bends. What it meets depends on its azimuth alone, and how high it
is there on its slope alone:

    azimuth = atan2(left, forward)        slope = up / hypot(forward, left)

So azimuths are cast once a frame as a table, and a pixel at horizontal distance d is at height z +
d * slope. A horizontal plane is simpler still: forward and up are the same along a row, and left is
the same down a column, so that what a row of pixels sees of the plane lies at even steps on a
straight line.
"""

import math
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from robots.api.messages import Camera
from robots.world.solids import Floats

Plane = npt.NDArray[np.float32]
Places = npt.NDArray[np.intp]
RAYS = 1024  # azimuths a frame: between one and two a pixel
ROWS = 2  # of a picture that share their azimuths
Scalar = TypeVar("Scalar", bound=np.generic)
LEVEL = 1e-4  # slopes are at least so far from 0, a twentieth of a pixel


@dataclass(frozen=True, eq=False)
class Lens:
    """Tables of one pitch.

    `ray` (height / 2, width) is the index of the pixel's azimuth in `azimuths` (RAYS,), whose unit
    vectors are `directions` (RAYS, 2), one for two rows, between which it changes by less than half
    a pixel; `slope` (ROWS, height / ROWS, width) is up over horizontal, the even rows before the
    odd ones, as in all tables of pixels; `above`, `below` (height,) are its greatest and least in
    each row. `ahead`, `up` (height,) and `right` (width,) are the parts of a pixel's direction,
    `line` (2, width) is a row of ones over `right`. `plane` (ROWS, height / ROWS, 3) is, of a
    horizontal plane one metre above or below the eye, for each row: 1, how far ahead it is met, and
    how far to the left a column with `right` 1 meets it. `begins`, `ends` are, for rows and for
    columns, the running minimum from the start and maximum from the end, negative so that they rise
    (for `searchsorted`).
    """

    width: int
    height: int
    focal: float
    pitch: float
    azimuths: Floats
    directions: Floats
    step: float
    ray: Places
    slope: Plane
    above: Floats
    below: Floats
    ahead: Floats
    up: Floats
    right: Floats
    line: Plane
    plane: Floats
    begins: tuple[Floats, Places]
    ends: tuple[Floats, Places]

    def columns(self, first: Places, last: Places) -> tuple[Places, Places]:
        """Return first and last + 1 column (n,) that rays first … last - 1 go through."""
        return np.searchsorted(self.begins[1], -last, side="right"), np.searchsorted(
            self.ends[1], -first, side="right"
        )

    def rows(self, highest: Floats, lowest: Floats) -> tuple[Places, Places]:
        """Return the first and one past the last row (n,) that has slopes between two."""
        return np.searchsorted(self.begins[0], -highest, side="left"), np.searchsorted(
            self.ends[0], -lowest, side="right"
        )

    def project(self, forward: Floats, left: Floats, up: Floats) -> tuple[Floats, Floats, Floats]:
        """Return (u, v) in pixels and depth of level points; depth <= 0 is behind the camera."""
        cosine, sine = math.cos(self.pitch), math.sin(self.pitch)
        depth = cosine * forward - sine * up
        safe = np.where(depth > LEVEL, depth, LEVEL)
        u = self.width / 2.0 - self.focal * left / safe
        v = self.height / 2.0 - self.focal * (sine * forward + cosine * up) / safe
        return u, v, depth


def grind(camera: Camera, pitch: float) -> Lens:
    """Return tables for a pitch in radians, positive down; takes milliseconds, so keep them."""
    focal = camera.width / 2.0 / math.tan(camera.hfov / 2.0)
    right = ((np.arange(camera.width) + 0.5 - camera.width / 2.0) / focal).astype(np.float64)
    down = ((np.arange(camera.height) + 0.5 - camera.height / 2.0) / focal).astype(np.float64)
    ahead = math.cos(pitch) - down * math.sin(pitch)
    up = -math.sin(pitch) - down * math.cos(pitch)
    # The picture is symmetric, so half of every table is computed and the other half reflected.
    half = -(-camera.width // 2)
    wide, deep = right.astype(np.float32)[None, :half], ahead.astype(np.float32)[:, None]
    azimuth = np.arctan2(-wide, deep[::ROWS])
    steep = up.astype(np.float32)[:, None] / np.sqrt(deep * deep + wide * wide)
    slope = _reflected(
        np.where(np.abs(steep) < LEVEL, np.float32(-LEVEL), steep).astype(np.float32), camera.width
    )
    highest = float(azimuth.max())
    step = 2.0 * highest / (RAYS - 1)
    azimuths = np.linspace(-highest, highest, RAYS)
    # how many rays lie to the left of it
    ahead_of = np.rint((np.float32(highest) - azimuth) * np.float32(1.0 / step)).astype(np.intp)
    ray = RAYS - 1 - ahead_of
    ray = np.concatenate([ray, ahead_of[:, : camera.width // 2][:, ::-1]], axis=1)
    above, below = slope.max(axis=1).astype(np.float64), slope.min(axis=1).astype(np.float64)
    up = np.where(np.abs(up) < LEVEL, -LEVEL, up)
    away = 1.0 / np.abs(up)
    return Lens(
        width=camera.width,
        height=camera.height,
        focal=focal,
        pitch=pitch,
        step=step,
        azimuths=azimuths,
        directions=np.column_stack([np.cos(azimuths), np.sin(azimuths)]),
        ray=ray,
        slope=in_turn(slope),
        above=above,
        below=below,
        ahead=ahead,
        up=up,
        right=right,
        plane=in_turn(np.stack([np.ones_like(away), away * ahead, -away], axis=1)),
        begins=(-np.minimum.accumulate(below), -np.minimum.accumulate(ray.min(axis=0))),
        ends=(
            -np.maximum.accumulate(above[::-1])[::-1],
            -np.maximum.accumulate(ray.max(axis=0)[::-1])[::-1],
        ),
        line=np.stack([np.ones_like(right), right]).astype(np.float32),
    )


def in_turn(rows: npt.NDArray[Scalar]) -> npt.NDArray[Scalar]:
    """Return a table (height, …) as (ROWS, height / ROWS, …): the even rows, then the odd ones."""
    return np.ascontiguousarray(rows.reshape(-1, ROWS, *rows.shape[1:]).swapaxes(0, 1))


def _reflected(left: Plane, width: int) -> Plane:
    """Return a table (height, width) from its left half, the middle column included."""
    return np.concatenate([left, left[:, : width // 2][:, ::-1]], axis=1)
