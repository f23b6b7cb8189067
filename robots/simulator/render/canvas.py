"""Frames before their colours: for every pixel the texel that it shows, fetched once at the end.

Walls reach from floor to ceiling, so one table over the azimuths gives for every pixel how far its
wall is, and the slope gives whether it sees floor, wall or ceiling. Things are lower than that;
they are painted over it from far to near, each only in its own window of the frame, hidden where
the wall is nearer.

All steps share the same buffers: pixels are handled in bands that stay in the processor's cache,
and hardly anything is allocated.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from robots.simulator.render.lens import RAYS, ROWS, Lens
from robots.simulator.render.rays import (
    EDGE,
    FAR,
    Distances,
    Eye,
    Mask,
    Places,
    angles,
    cast,
    looks_at,
    spans,
)
from robots.simulator.render.scene import (
    CEILING_DENSITY,
    FLOOR_DENSITY,
    WALL_DENSITY,
    Lid,
    RenderScene,
)
from robots.simulator.render.texture_atlas import FLOOR_LEVELS, HOLE, LEVELS, Flat
from robots.simulator.render.visibility import NEAR, ItemSight, PictureWindow
from robots.world.solids import Floats

BAND = 32768  # pixels at a time
FLATTEST = 0.05  # a wall seen at a smaller angle than this, in radians, gets no coarser
# metres, steps that they are measured in, share of the light that is taken at most
SHADOW, STEPS, DARKEST = 0.42, 128, 0.5
BLACK = 16
SAME = np.eye(2)

Image = npt.NDArray[np.uint8]
Indices = npt.NDArray[np.int32]
Heights = npt.NDArray[np.float32]
Scalar = TypeVar("Scalar", bound=np.generic)


@dataclass(frozen=True, eq=False)
class Walls:
    """The length of each ray (RAYS,), and the atlas offset of the texture column that it hits."""

    reach: Distances
    texel: Indices


class Canvas:
    """Texels (height, width) of a scene, even rows before odd ones. For one thread."""

    def __init__(self, scene: RenderScene, width: int, height: int) -> None:
        self._scene = scene
        self._texels: Indices = np.zeros((ROWS, height // ROWS, width), dtype=np.int32)
        self._heights = np.empty(BAND, dtype=np.float32)
        self._reaches = np.empty(BAND // ROWS, dtype=np.float32)
        self._points = np.empty(2 * BAND, dtype=np.float32)
        self._cells = np.empty(2 * BAND, dtype=np.int32)
        self._index = np.empty(BAND, dtype=np.int32)
        self._columns = np.empty(BAND // ROWS, dtype=np.int32)
        self._places = np.empty(BAND, dtype=np.intp)
        self._mask = np.empty(BAND, dtype=np.bool_)
        self._second = np.empty(BAND, dtype=np.bool_)
        self._octets = np.empty(BAND, dtype=np.uint8)
        self._chroma = np.empty(BAND, dtype="<u2")

    # --- walls, floor, ceiling --------------------------------------------------------------------

    def cast_walls(self, lens: Lens, eye: Eye) -> Walls:
        """Return what the rays of an eye meet."""
        scene = self._scene
        facing = np.flatnonzero(looks_at(scene.walls, eye.origin))
        faces = scene.walls[facing]
        azimuths = angles(eye.level(faces.reshape(-1, 2)))
        first, last = spans(lens, azimuths[0::2], azimuths[1::2], eye.rays())
        found = cast(faces, first, last, eye, eye.directions(lens))
        met = np.flatnonzero(found.met)
        ray, reach = found.ray[met], found.reach[met]
        nearest = np.full(RAYS, FAR)
        np.minimum.at(nearest, ray, reach)
        first_met = np.flatnonzero(reach == nearest[ray])
        texel = np.zeros(RAYS, dtype=np.int32)
        chosen = met[first_met]
        which = facing[found.row[chosen]]
        texel[ray[first_met]] = self._wall_columns(
            lens, which, reach[first_met], found.share[chosen], np.abs(found.across[chosen])
        )
        return Walls(nearest.astype(np.float32), texel)

    def _wall_columns(
        self, lens: Lens, which: npt.NDArray[np.intp], reach: Floats, share: Floats, across: Floats
    ) -> npt.NDArray[np.intp]:
        """Return where each ray's texel column begins, in the copy that fits a pixel there."""
        scene = self._scene
        sine = np.minimum(across / scene.wall_lengths[which], 1.0)
        stretched = np.maximum(1.0, 0.5 / np.maximum(sine, FLATTEST))
        pixel = reach / lens.focal * stretched * WALL_DENSITY
        level = np.clip(np.log2(np.maximum(pixel, EDGE)) + 0.5, 0, LEVELS - 1).astype(np.intp)
        column = np.clip(share, 0.0, 1.0 - EDGE) * scene.wall_columns[level, which]
        begins: npt.NDArray[np.intp] = (
            scene.wall_offsets[level, which] + column.astype(np.intp) * scene.wall_rows
        )
        return begins

    def paint_walls(
        self, lens: Lens, eye: Eye, walls: Walls, window: PictureWindow, stencil: Mask | None
    ) -> None:
        """Paint walls, floor and ceiling of one eye."""
        first, last = eye.rays()
        reach = walls.reach[first:last]
        nearest, farthest = float(reach.min()), float(reach.max())
        texels = Walls(walls.reach * np.float32(WALL_DENSITY), walls.texel)
        planes = self._planes(eye)
        for part in _bands(window.paired):
            highest = float(lens.above[part.top : part.bottom].max())
            steepest = float(lens.below[part.top : part.bottom].min())
            if eye.height + highest * (nearest if highest < 0.0 else farthest) < 0.0:
                np.copyto(
                    self._texels[part.pairs],
                    self._floor(lens, eye, planes[0], part),
                    where=True if stencil is None else stencil[part.pairs],
                )
                continue
            sees_floor = eye.height + min(steepest * farthest, steepest * nearest) < 0.0
            top = eye.height + max(highest * farthest, highest * nearest)
            height, index = self._paint_band(lens, eye, texels, part, stencil)
            if sees_floor:
                below = np.less(height, np.float32(0.0), out=_cut(self._mask, part))
                # down to the end: the middle row of what sees floor decides on the copy
                rows = slice(_rows(below).start, None)
                np.copyto(
                    index[:, rows],
                    self._floor(lens, eye, planes[0], _part(part, rows)),
                    where=below[:, rows],
                )
            if top >= self._scene.ceiling:
                ceiling = np.float32(self._scene.ceiling * WALL_DENSITY)
                above = np.greater_equal(height, ceiling, out=_cut(self._mask, part))
                rows = _rows(above)
                np.copyto(
                    index[:, rows],
                    self._flat(lens, _part(part, rows), self._scene.roof, planes[1], 0),
                    where=above[:, rows],
                )
            if stencil is not None:
                np.copyto(self._texels[part.pairs], index, where=stencil[part.pairs])

    def _paint_band(
        self, lens: Lens, eye: Eye, walls: Walls, part: PictureWindow, stencil: Mask | None
    ) -> tuple[Heights, Indices]:
        """Return a band's heights above the floor and texels, painted unless stencilled."""
        height, index = _cut(self._heights, part), _cut(self._index, part)
        ray = lens.ray[part.pairs]
        self._rise(walls.reach, ray, lens.slope[part.pairs], height)
        np.add(height, np.float32(eye.height * WALL_DENSITY), out=height)
        np.copyto(index, height, casting="unsafe")
        return height, self._shift(
            index, walls.texel, ray, self._texels[part.pairs] if stencil is None else index
        )

    def _rise(self, reach: Distances, ray: Places, slope: Heights, out: Heights) -> Heights:
        """Return heights above the eye of pixels (ROWS, n, columns) at `reach` (RAYS,)."""
        far = reach.take(ray, out=self._reaches[: ray.size].reshape(ray.shape), mode="clip")
        return np.multiply(far, slope, out=out)

    def _shift(self, index: Indices, texel: Indices, ray: Places, out: Indices) -> Indices:
        """Return texels (ROWS, n, columns) of pixels in the columns that begin at `texel`."""
        begin = texel.take(ray, out=self._columns[: ray.size].reshape(ray.shape), mode="clip")
        return np.add(index, begin, out=out)

    def _planes(self, eye: Eye) -> tuple[Floats, Floats]:
        """Return floor and ceiling for `_on_plane`, in texels of the finest copy."""
        corner, ceiling = self._scene.corner, self._scene.ceiling
        return (
            _plane(eye, eye.height, SAME * FLOOR_DENSITY, -corner * FLOOR_DENSITY),
            _plane(eye, ceiling - eye.height, SAME * CEILING_DENSITY, -corner * CEILING_DENSITY),
        )

    def _floor(self, lens: Lens, eye: Eye, plane: Floats, part: PictureWindow) -> Indices:
        """Return floor texels from the copy that fits a pixel: geometric mean of both ways."""
        middle = (part.top + part.bottom) // 2
        slope = max(EDGE, -float(lens.slope[middle % ROWS, middle // ROWS, lens.width // 2]))
        pixel = eye.height / slope / lens.focal * math.sqrt(math.hypot(1.0, 1.0 / slope))
        level = min(FLOOR_LEVELS - 1, max(0, round(math.log2(pixel * FLOOR_DENSITY))))
        return self._flat(lens, part, self._scene.floor, plane, level)

    def _flat(
        self, lens: Lens, part: PictureWindow, flat: Flat, plane: Floats, level: int
    ) -> Indices:
        """Return where in the atlas each pixel's point of the floor or the ceiling is."""
        points = self._on_plane(lens, part, plane / (1 << level))
        return _fetched(*points, flat.widths[level], flat.offsets[level])

    def _on_plane(
        self, lens: Lens, part: PictureWindow, plane: Floats, limits: tuple[int, int] | None = None
    ) -> tuple[Indices, Indices]:
        """Return both coordinates of the points of a horizontal plane that a window's pixels see,
        as whole numbers; `plane` is `_plane`.

        Along a row they are at even steps: one number a row, and one a row times one a column,
        which is a product of two matrices.
        """
        rows, columns = (part.bottom - part.top) // ROWS, part.right - part.left
        lines = np.matmul(
            lens.plane[:, part.top // ROWS : part.bottom // ROWS].reshape(-1, 3), plane
        ).astype(np.float32)
        count = 2 * ROWS * rows * columns
        points = self._points[:count].reshape(-1, columns)
        found = self._cells[:count].reshape(-1, columns)
        np.matmul(lines.reshape(-1, 2), lens.line[:, part.left : part.right], out=points)
        if limits is not None:
            for axis, limit in enumerate(limits):
                half = points[axis * ROWS * rows : (axis + 1) * ROWS * rows]
                np.minimum(
                    np.maximum(half, np.float32(0.0), out=half), np.float32(limit - 1), out=half
                )
        np.copyto(found, points, casting="unsafe")
        across, up = found.reshape(2, ROWS, rows, columns)
        return across, up

    # --- things -----------------------------------------------------------------------------------

    def paint(self, lens: Lens, eye: Eye, sights: list[ItemSight], stencil: Mask | None) -> None:
        """Paint things, the far ones first."""
        for sight in sights:
            reach = sight.entry * np.float32(sight.item.density)
            for part in _bands(sight.window.paired):
                self._paint_side(lens, eye, sight, reach, part, stencil)
            item, window = sight.item, sight.window
            if item.lid is not None and eye.height > item.top:
                rows, plane = sight.upper, item.top
            elif item.under >= 0 and eye.height < item.bottom:
                rows, plane = sight.lower, item.bottom
            else:
                continue
            face = window._replace(top=max(rows[0], window.top), bottom=min(rows[1], window.bottom))
            for part in _bands(face.paired):
                self._paint_face(lens, eye, sight, plane, part, stencil)

    def _paint_side(
        self,
        lens: Lens,
        eye: Eye,
        sight: ItemSight,
        reach: Distances,
        part: PictureWindow,
        stencil: Mask | None,
    ) -> None:
        """Paint a thing's upright sides between its edges; `reach` in texels."""
        item, where = sight.item, part.pairs
        height, index = _cut(self._heights, part), _cut(self._index, part)
        mask, ray = _cut(self._mask, part), lens.ray[where]
        self._rise(reach, ray, lens.slope[where], height)
        # over its foot, 1 more: rounding to 0 rounds down
        np.add(height, np.float32((eye.height - item.bottom) * item.density + 1.0), out=height)
        np.copyto(index, height, casting="unsafe")
        np.subtract(index, np.int32(1), out=index)
        # negative numbers become very large
        np.less(index.view(np.uint32), np.uint32(item.rows), out=mask)
        if stencil is not None:
            np.logical_and(mask, stencil[where], out=mask)
        self._shift(index, sight.texel, ray, index)
        if item.holes:
            places = _cut(self._places, part)
            np.copyto(places, index)
            np.logical_and(
                mask, self._scene.texture_atlas.luma.take(places, mode="clip") != HOLE, out=mask
            )
        np.copyto(self._texels[where], index, where=mask)

    def _paint_face(
        self,
        lens: Lens,
        eye: Eye,
        sight: ItemSight,
        plane: float,
        part: PictureWindow,
        stencil: Mask | None,
    ) -> None:
        """Paint a lid or underside: where rays meet its plane between coming in and out."""
        item, where = sight.item, part.pairs
        height = _cut(self._heights, part)
        mask = _cut(self._mask, part)
        second = _cut(self._second, part)
        ray, slope, drop = lens.ray[where], lens.slope[where], np.float32(plane - eye.height)
        beyond, short = (
            (np.greater_equal, np.less) if plane < eye.height else (np.less, np.greater_equal)
        )
        beyond(self._rise(sight.entry, ray, slope, height), drop, out=mask)
        np.logical_and(
            mask, short(self._rise(sight.leave, ray, slope, height), drop, out=second), out=mask
        )
        if stencil is not None:
            np.logical_and(mask, stencil[where], out=mask)
        lid = item.lid if plane < eye.height else None
        if lid is None or lid.width * lid.height == 1:
            np.copyto(
                self._texels[where], np.int32(item.under if lid is None else lid.offset), where=mask
            )
        else:
            rows = _rows(mask)
            part = _part(part, rows)
            np.copyto(
                self._texels[part.pairs],
                self._picture_on(lid, lens, eye, eye.height - plane, part),
                where=mask[:, rows],
            )

    def _picture_on(
        self, lid: Lid, lens: Lens, eye: Eye, rise: float, part: PictureWindow
    ) -> Indices:
        plane = _plane(eye, rise, lid.matrix, lid.shift)
        size = (lid.width, lid.height)
        return _fetched(*self._on_plane(lens, part, plane, size), lid.width, lid.offset)

    def stencil(
        self,
        lens: Lens,
        eye: Eye,
        reach: Floats,
        heights: tuple[float, float],
        window: PictureWindow,
    ) -> Mask:
        """Return (ROWS, height / ROWS, width): rays at a pane; `reach` (RAYS,) is FAR beside."""
        stencil = np.zeros(self._texels.shape, dtype=np.bool_)
        distances = reach.astype(np.float32)
        for part in _bands(window.paired):
            height, above = _cut(self._heights, part), _cut(self._mask, part)
            self._rise(distances, lens.ray[part.pairs], lens.slope[part.pairs], height)
            np.greater_equal(height, np.float32(heights[0] - eye.height), out=above)
            np.logical_and(
                above,
                np.less(height, np.float32(heights[1] - eye.height), out=_cut(self._second, part)),
                out=stencil[part.pairs],
            )
        return stencil

    # --- the picture ------------------------------------------------------------------------------

    def develop(self, out: Image) -> None:
        """Fetch texels into `out`, (height * 3 / 2, width), contiguous: Y, then U, V at half."""
        _, pairs, width = self._texels.shape
        texture_atlas = self._scene.texture_atlas
        luma = in_pairs(out[: ROWS * pairs])
        blue, red = out[ROWS * pairs :].reshape(2, pairs, width // 2)
        for part in _bands(PictureWindow(0, ROWS * pairs, 0, width)):
            rows, places = slice(part.top // ROWS, part.bottom // ROWS), _cut(self._places, part)
            np.copyto(places, self._texels[:, rows])
            np.copyto(
                luma[:, rows],
                texture_atlas.luma.take(places, out=_cut(self._octets, part), mode="clip"),
            )
            coarse = places[0, :, ::2]
            chroma = texture_atlas.chroma.take(
                coarse, out=self._chroma[: coarse.size].reshape(coarse.shape), mode="clip"
            ).view(np.uint8)
            blue[rows], red[rows] = chroma[:, 0::2], chroma[:, 1::2]

    def darken(
        self, lens: Lens, eye: Eye, walls: Walls, place: tuple[float, float], out: Image
    ) -> None:
        """Put a person's soft shadow on the floor of a developed frame, unless a wall hides it."""
        forward, left = eye.level(np.array([place]))[0].tolist()
        ray = round((math.atan2(left, forward) - float(lens.azimuths[0])) / lens.step)
        if math.hypot(forward, left) > walls.reach[min(max(ray, 0), RAYS - 1)]:
            return
        corners = SHADOW * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
        level = eye.level(np.array(place) + corners)
        u, v, depth = lens.project(level[:, 0], level[:, 1], np.full(4, -eye.height))
        if depth.min() < NEAR:
            return
        limits = (v.min(), v.max() + 1, u.min(), u.max() + 1)
        window = PictureWindow(*(round(float(limit)) for limit in limits)).within(
            PictureWindow(0, lens.height, 0, lens.width)
        )
        scale, floor, picture = STEPS / SHADOW, self._scene.floor, in_pairs(out[: lens.height])
        plane = _plane(eye, eye.height, SAME * scale, -np.array(place) * scale)
        end = floor.offsets[-1] + floor.widths[-1] * floor.heights[-1]
        for part in _bands(window.paired):
            x, y = self._on_plane(lens, part, plane)
            near = np.maximum(1.0 - (x * x + y * y) / np.float32(STEPS**2), 0.0)
            texels, luma = self._texels[part.pairs], picture[part.pairs]
            near[(texels < floor.offsets[0]) | (texels >= end)] = 0.0
            luma -= ((luma - np.float32(BLACK)) * near * np.float32(DARKEST)).astype(np.uint8)


def _fetched(across: Indices, up: Indices, width: int, offset: int) -> Indices:
    """Return texel numbers of a texture `width` wide from `offset` on; overwrites `up`."""
    np.multiply(up, np.int32(width), out=up)
    np.add(up, across, out=up)
    np.add(up, np.int32(offset), out=up)
    return up


def _bands(window: PictureWindow) -> Iterator[PictureWindow]:
    """Yield a window in bands of at most BAND pixels and an even number of rows."""
    if window.is_empty:
        return
    if (window.bottom - window.top) * (window.right - window.left) <= BAND:
        yield window
        return
    rows = max(2, BAND // (window.right - window.left) // 2 * 2)
    for top in range(window.top, window.bottom, rows):
        yield PictureWindow(top, min(top + rows, window.bottom), window.left, window.right)


def _rows(mask: Mask) -> slice:
    """Return the pairs of rows of a mask (ROWS, n, columns) from its first to last pixel."""
    there: Mask = np.logical_or.reduce(mask, axis=(0, 2))
    if not there.any():
        return slice(0, 0)
    return slice(int(there.argmax()), len(there) - int(there[::-1].argmax()))


def _part(window: PictureWindow, rows: slice) -> PictureWindow:
    """Return some of a window's pairs of rows."""
    first, last, _ = rows.indices((window.bottom - window.top) // ROWS)
    return window._replace(top=window.top + ROWS * first, bottom=window.top + ROWS * last)


def _plane(eye: Eye, rise: float, matrix: Floats, shift: Floats) -> Floats:
    """Return the matrix (2, 3, 2) that turns `Lens.plane` into the lines of matrix @ (x, y) + shift
    on a plane `rise` metres from the eye.
    """
    plane = np.zeros((2, 3, 2))
    turn = matrix @ eye.world_from_level * rise
    plane[:, 0, 0] = matrix @ eye.origin + shift
    plane[:, 1, 0] = turn[:, 0]
    plane[:, 2, 1] = turn[:, 1]
    return plane


def in_pairs(rows: npt.NDArray[Scalar]) -> npt.NDArray[Scalar]:
    """Return a view of (height, width) as (ROWS, height / ROWS, width): even rows, then odd."""
    return rows.reshape(-1, ROWS, rows.shape[1]).swapaxes(0, 1)


def _cut(buffer: npt.NDArray[Scalar], window: PictureWindow) -> npt.NDArray[Scalar]:
    """Return a buffer's beginning as a window's pixels (ROWS, height / ROWS, width)."""
    pairs, columns = (window.bottom - window.top) // ROWS, window.right - window.left
    return buffer[: ROWS * pairs * columns].reshape(ROWS, pairs, columns)
