"""A body drawn from one side in orthographic projection, each limb a rounded cone."""

import math
from dataclasses import dataclass

import numpy as np

from robots.simulator.render.body import Limb
from robots.simulator.render.materials import Picture, Plane
from robots.world.solids import Floats

DENSITY = 100.0  # texels a metre
REACH = 0.62  # metres to either side of the middle that a body may take
LIGHT = np.array([-0.35, 0.62, 0.70], dtype=np.float32)  # from: right, up, towards the viewer
SHADE = 0.58
STRIPE = 0.07  # metres


@dataclass(frozen=True, eq=False)
class Sprite:
    """A picture (columns, rows, 3), NaN beside the body; its left edge is at `left` metres."""

    picture: Picture
    left: float

    @property
    def right(self) -> float:
        return self.left + len(self.picture) / DENSITY


def draw(limbs: list[Limb], bearing: float, height: float) -> Sprite:
    """Return a body as seen from `bearing` in its frame, radians: 0 before it, pi / 2 at its left;
    `height` is that of the picture in metres.
    """
    columns, rows = round(2.0 * REACH * DENSITY), round(height * DENSITY)
    picture = np.full((columns, rows, 3), np.nan, dtype=np.float32)
    depth = np.full((columns, rows), -np.inf, dtype=np.float32)
    across = ((np.arange(columns) + 0.5) / DENSITY - REACH).astype(np.float32)
    up = ((np.arange(rows) + 0.5) / DENSITY).astype(np.float32)
    cosine, sine = math.cos(bearing), math.sin(bearing)
    # Rows: to the right of the viewer, up, towards the viewer.
    view = np.array([[-sine, cosine, 0.0], [0.0, 0.0, 1.0], [cosine, sine, 0.0]])
    for limb in limbs:
        _draw_limb(picture, depth, across, up, limb, view)
    seen = np.flatnonzero(np.isfinite(depth).any(axis=1))
    first, last = (int(seen[0]), int(seen[-1]) + 1) if len(seen) else (0, 1)
    return Sprite(picture[first:last].copy(), first / DENSITY - REACH)


def _draw_limb(
    picture: Picture, depth: Plane, across: Plane, up: Plane, limb: Limb, view: Floats
) -> None:
    start, end = (view @ limb.start).astype(np.float32), (view @ limb.end).astype(np.float32)
    thick = max(limb.start_radius, limb.end_radius)
    low, high = np.minimum(start, end) - thick, np.maximum(start, end) + thick
    where = (
        slice(*np.searchsorted(across, [low[0], high[0]]).tolist()),
        slice(*np.searchsorted(up, [low[1], high[1]]).tolist()),
    )
    u, z = across[where[0], None], up[None, where[1]]
    along = end - start
    length = max(float(along[0] ** 2 + along[1] ** 2), 1e-9)
    share = np.clip(((u - start[0]) * along[0] + (z - start[1]) * along[1]) / length, 0.0, 1.0)
    radius = limb.start_radius + share * (limb.end_radius - limb.start_radius)
    aside, above = u - start[0] - share * along[0], z - start[1] - share * along[1]
    squared = radius**2 - aside**2 - above**2
    bulge = np.sqrt(np.maximum(squared, 0.0))
    near = start[2] + share * along[2] + bulge
    seen = (squared > 0.0) & (near > depth[where])
    facing = (LIGHT[0] * aside + LIGHT[1] * above + LIGHT[2] * bulge) / radius
    light = SHADE + (1.0 - SHADE) * np.maximum(facing, 0.0) * 1.2
    if limb.stripes:
        light = np.where(np.mod(z + 0.0 * u, 2.0 * STRIPE) < STRIPE, light, light * 0.72)
    picture[where][seen] = np.minimum(light[seen][:, None] * limb.colour, 1.0)
    depth[where][seen] = near[seen]
