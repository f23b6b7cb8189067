"""All textures of a scene in one array, so that a whole frame is one gather.

A texel is stored as the video needs it: a byte of luma, and two of chroma, U and V, which are
fetched for every fourth pixel only (BT.601, 16 to 235). Luma 0 is `HOLE`: transparent. Smaller
copies (mipmaps) keep distant patterns from flickering. An upright texture is stored column by
column, and its copies are smaller along the wall only: the row of a height is then the same in all
of them, and upwards they are blurred instead.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from robots.simulator.render.materials import Picture, Plane

Luma = npt.NDArray[np.uint8]
Chroma = npt.NDArray[np.uint16]
HOLE = 0
LEVELS = 3
FLOOR_LEVELS = 4
SPACE = 1 << 22  # texels at first

# Rows Y, U, V of red, green, blue from 0 to 1 (ITU-R BT.601).
_WEIGHTS = np.array(
    [[65.481, 128.553, 24.966], [-37.797, -74.203, 112.0], [112.0, -93.786, -18.214]],
    dtype=np.float32,
)
_BLACK = np.array([16.0, 128.0, 128.0], dtype=np.float32)


@dataclass(frozen=True)
class Upright:
    """A wall's texture: each level's offset and columns; `rows` is the same in all."""

    offsets: tuple[int, ...]
    columns: tuple[int, ...]
    rows: int


@dataclass(frozen=True)
class Flat:
    """A floor's texture: the offset, width and height of each level, in texels."""

    offsets: tuple[int, ...]
    widths: tuple[int, ...]
    heights: tuple[int, ...]


def pack(picture: Picture) -> tuple[Luma, Chroma]:
    """Return luma and chroma, U + 256 V, (n * m,) of a picture (n, m, 3) from 0 to 1; NaN becomes a
    hole.
    """
    colours = picture.reshape(-1, 3)
    holes = np.isnan(colours[:, 0])
    if holes.any():
        colours = np.where(holes[:, None], np.float32(0.0), colours)
    parts = np.clip(colours, 0.0, 1.0) @ _WEIGHTS.T
    parts += _BLACK + np.float32(0.5)
    octets = parts.astype(np.uint8)
    luma = octets[:, 0].copy()
    luma[holes] = HOLE
    return luma, (octets[:, 1] | octets[:, 2].astype(np.uint16) << 8).astype("<u2")


class TextureAtlas:
    """Collects textures; `luma` and `chroma` are replaced by larger arrays as it grows."""

    def __init__(self) -> None:
        self.luma: Luma = np.empty(SPACE, dtype=np.uint8)
        self.chroma: Chroma = np.empty(SPACE, dtype="<u2")
        self._size = 0

    def upright(self, picture: Picture) -> Upright:
        """Add a wall's texture (columns, rows, 3)."""
        offsets, columns, level = [], [], picture
        for number in range(LEVELS):
            offsets.append(self._add(level))
            columns.append(level.shape[0])
            if number + 1 < LEVELS:
                level = _narrower(level)
        return Upright(tuple(offsets), tuple(columns), picture.shape[1])

    def flat(self, picture: Picture, levels: int = FLOOR_LEVELS) -> Flat:
        """Add a floor's texture (rows, columns, 3)."""
        offsets, widths, heights, level = [], [], [], picture
        for number in range(levels):
            offsets.append(self._add(level))
            heights.append(level.shape[0])
            widths.append(level.shape[1])
            if number + 1 < levels:
                level = _smaller(level)
        return Flat(tuple(offsets), tuple(widths), tuple(heights))

    def colour(self, colour: Plane) -> int:
        """Add one colour (3,) and return its offset."""
        return self._add(colour[None, None, :])

    def _add(self, picture: Picture) -> int:
        luma, chroma = pack(picture)
        begin, end = self._size, self._size + luma.size
        while end > self.luma.size:
            self.luma = np.concatenate([self.luma, np.empty_like(self.luma)])
            self.chroma = np.concatenate([self.chroma, np.empty_like(self.chroma)])
        self.luma[begin:end], self.chroma[begin:end] = luma, chroma
        self._size = end
        return begin


def _narrower(picture: Picture) -> Picture:
    even = picture if picture.shape[0] % 2 == 0 else np.concatenate([picture, picture[-1:]])
    one, other = even[0::2], even[1::2]
    halved: Picture = (one + other) * np.float32(0.5)
    holes = np.isnan(halved)
    if holes.any():  # keep texels next to a hole, so that stalks and arms do not vanish far away
        return np.where(holes, np.where(np.isnan(one), other, one), halved)
    blurred: Picture = ndimage.uniform_filter1d(halved, 2, axis=1)
    return blurred


def _smaller(picture: Picture) -> Picture:
    pads = [(0, picture.shape[0] % 2), (0, picture.shape[1] % 2), (0, 0)]
    even = np.pad(picture, pads, mode="edge") if any(pad[1] for pad in pads) else picture
    four = even[0::2, 0::2] + even[1::2, 0::2] + even[0::2, 1::2] + even[1::2, 1::2]
    return four * np.float32(0.25)
