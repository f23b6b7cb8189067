"""Textures of walls and floors, computed from metres.

A wall's texture is (columns, rows, 3) float32 from 0 to 1: first axis along the wall, left to right
for the viewer, second axis upwards, so that one column of the camera reads neighbouring texels. A
floor's is (rows, columns, 3) along y and x. Coordinates are in metres with any origin, so that
patterns continue round corners and from room to room.
"""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from scipy import ndimage

Picture = npt.NDArray[np.float32]
Plane = npt.NDArray[np.float32]
Material = Callable[[Plane, Plane, Plane, np.random.Generator], Picture]

BASEBOARD = 0.09
RAIL = 1.05  # height of the edge between two tones
WHITE = np.array([0.95, 0.94, 0.91], dtype=np.float32)


def rgb(colour: str) -> Plane:
    """Return `#rrggbb` as (3,) from 0 to 1."""
    return np.array([int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5)], dtype=np.float32)


def noise(shape: tuple[int, int], cell: tuple[float, float], rng: np.random.Generator) -> Plane:
    """Return smooth noise of about ±1; `cell` is how many texels one bump is long on each axis."""
    if cell == (1, 1):
        return rng.standard_normal(shape, dtype=np.float32)
    coarse = rng.standard_normal(
        (int(shape[0] / cell[0]) + 3, int(shape[1] / cell[1]) + 3), dtype=np.float32
    )
    return _stretch(_stretch(coarse, shape[0], cell[0]).T, shape[1], cell[1]).T


def _stretch(coarse: Plane, count: int, cell: float) -> Plane:
    """Return (count, m) straight between the rows of (n, m), `cell` apart."""
    at = np.arange(count, dtype=np.float32) / np.float32(cell)
    row = at.astype(np.intp)
    share = (at - row)[:, None]
    stretched: Plane = coarse[row]
    stretched += (coarse[row + 1] - stretched) * share
    return stretched


def tint(plane: Plane, colour: Plane) -> Picture:
    """Return brightness (n, m) times a colour (3,)."""
    return plane[..., None] * colour


def metres(columns: int, rows: int, density: float) -> tuple[Plane, Plane]:
    """Return where a wall's texels are: u (columns, 1) and z (1, rows) in metres."""
    u = (np.arange(columns, dtype=np.float32) + np.float32(0.5))[:, None] / np.float32(density)
    z = (np.arange(rows, dtype=np.float32) + np.float32(0.5))[None, :] / np.float32(density)
    return u, z


def per_piece(number: npt.NDArray[np.int_], rng: np.random.Generator) -> Plane:
    """Return a random value in [-1, 1] for each integer, always the same one."""
    table = rng.uniform(-1.0, 1.0, 4096).astype(np.float32)
    return table[(number * 2654435761) % 4096]


# --- walls: (u, z, colour, rng) -> picture; u (columns, 1) and z (1, rows) in metres --------------


def plaster(u: Plane, z: Plane, colour: Plane, rng: np.random.Generator) -> Picture:
    """Paint on plaster: a little grain, a little cloud."""
    grain, cloud = (noise((u.size, z.size), (cell, cell), rng) for cell in (1, 60))
    return tint(1.0 + 0.009 * grain + 0.02 * cloud, colour)


def two_tone(u: Plane, z: Plane, colour: Plane, rng: np.random.Generator) -> Picture:
    """A corridor's washable paint below, off-white above, a rail between."""
    picture = plaster(u, z, rgb("#f1ece0"), rng)
    low = z[0] < RAIL
    picture[:, low] = plaster(u, z[:, low], colour, rng)
    rail = (z[0] >= RAIL) & (z[0] < RAIL + 0.05)
    picture[:, rail] = rgb("#d9d2c0")
    picture[:, (z[0] >= RAIL) & (z[0] < RAIL + 0.012)] *= 0.72
    return picture


def wallpaper(u: Plane, z: Plane, colour: Plane, rng: np.random.Generator) -> Picture:
    """Broad stripes with a small ornament."""
    stripe = np.where(np.mod(u, 0.30) < 0.15, 1.0, 0.93)
    a, b = np.mod(u, 0.15) - 0.075, np.mod(z + 0.11 * np.floor(u / 0.15), 0.22) - 0.11
    petal = np.abs(np.hypot(a, b * 0.7) - 0.032) < 0.009
    dot = np.hypot(a, b) < 0.012
    plane = stripe * np.where(petal | dot, 0.86, 1.0) + 0.01 * noise((u.size, z.size), (1, 1), rng)
    return tint(plane.astype(np.float32), colour)


def brick(u: Plane, z: Plane, colour: Plane, rng: np.random.Generator) -> Picture:
    """Stretcher bond, each brick of its own tone, lit from above."""
    row = np.floor(z / 0.075).astype(np.int_)
    along = u + 0.12 * (row % 2)
    column = np.floor(along / 0.24).astype(np.int_)
    across, up = np.mod(along, 0.24), np.mod(z, 0.075) + 0.0 * along
    mortar = (across < 0.010) | (up < 0.010)
    tone = 1.0 + 0.16 * per_piece(column + 997 * row, rng)
    tone = tone + 0.05 * noise((u.size, z.size), (2, 2), rng)
    tone *= np.where(up > 0.062, 1.08, np.where(up < 0.02, 0.88, 1.0))
    picture = tint(tone.astype(np.float32), colour)
    picture[mortar] = rgb("#b9ada0") * 0.92
    return picture


def panelling(u: Plane, z: Plane, colour: Plane, rng: np.random.Generator) -> Picture:
    """Wooden boards up to a rail, warm paint above."""
    picture = plaster(u, z, rgb("#efe3cc"), rng)
    low = z[0] < RAIL
    picture[:, low] = _boards(u, z[:, low], colour, rng)
    rail = (z[0] >= RAIL) & (z[0] < RAIL + 0.06)
    picture[:, rail] = colour * 0.85
    picture[:, (z[0] >= RAIL + 0.045) & (z[0] < RAIL + 0.06)] *= 1.15
    return picture


def _boards(u: Plane, z: Plane, colour: Plane, rng: np.random.Generator) -> Picture:
    width = 0.12
    board = np.floor(u / width).astype(np.int_)
    fine, coarse = (noise((u.size, z.size), cell, rng) for cell in ((1.2, 40), (3, 120)))
    tone = 1.0 + 0.09 * per_piece(board, rng) + (fine * 0.05 + coarse * 0.05)
    tone = tone * np.where(np.mod(u, width) < 0.009, 0.62, 1.0)
    return tint(tone.astype(np.float32), colour)


def wood(u: Plane, z: Plane, colour: Plane, rng: np.random.Generator) -> Picture:
    """A sheet of wood, its grain along the first axis."""
    shape = (u.size, z.size)
    tone = 1.0 + 0.06 * noise(shape, (50, 1.3), rng) + 0.05 * noise(shape, (140, 5), rng)
    return tint(tone.astype(np.float32), colour)


def fabric(u: Plane, z: Plane, colour: Plane, rng: np.random.Generator) -> Picture:
    weave, folds = (noise((u.size, z.size), (cell, cell), rng) for cell in (1, 14))
    return tint(1.0 + 0.035 * weave + 0.05 * folds, colour)


def concrete(u: Plane, z: Plane, colour: Plane, rng: np.random.Generator) -> Picture:
    """Bare concrete with the joints of its formwork."""
    shape = (u.size, z.size)
    tone = 1.0 + 0.03 * noise(shape, (1, 1), rng) + 0.06 * noise(shape, (40, 40), rng)
    joint = (np.mod(u, 1.2) < 0.01) | (np.mod(z, 1.2) < 0.01)
    return tint((tone * np.where(joint, 0.8, 1.0)).astype(np.float32), colour)


def plain(u: Plane, z: Plane, colour: Plane, rng: np.random.Generator) -> Picture:
    """One colour with very little noise."""
    return tint(1.0 + 0.01 * noise((u.size, z.size), (3, 3), rng), colour)


WALLS: dict[str, Material] = {
    "plaster": plaster,
    "two_tone": two_tone,
    "wallpaper": wallpaper,
    "brick": brick,
    "panelling": panelling,
    "concrete": concrete,
    "trim": plain,
    "wood": wood,
    "fabric": fabric,
    "plain": plain,
}


def skirt(picture: Picture, z: Plane, ceiling: float) -> None:
    """Put a baseboard and a cornice onto a wall's picture."""
    height = z[0]
    board = height < BASEBOARD
    picture[:, board] = WHITE * 0.97
    picture[:, (height >= BASEBOARD - 0.012) & board] = WHITE * 0.78
    picture[:, (height >= BASEBOARD) & (height < BASEBOARD + 0.012)] *= 0.86
    cornice = height > ceiling - 0.05
    picture[:, cornice] = WHITE
    picture[:, (height > ceiling - 0.062) & ~cornice] *= 0.84


# --- floors: (x, y, colour, rng) -> picture; x (1, columns) and y (rows, 1) in metres -------------


def oak(x: Plane, y: Plane, colour: Plane, rng: np.random.Generator) -> Picture:
    """Planks along x, 14 cm wide, joints staggered."""
    row = np.floor(y / 0.14).astype(np.int_)
    along = x + 0.53 * (row % 5) + 0.21 * (row % 3)
    plank = np.floor(along / 1.3).astype(np.int_)
    fine, coarse = (noise((y.size, x.size), cell, rng) for cell in ((1.3, 45), (4, 110)))
    tone = 1.0 + 0.11 * per_piece(plank + 613 * row, rng) + (fine * 0.045 + coarse * 0.045)
    gap = (np.mod(y, 0.14) < 0.010) | (np.mod(along, 1.3) < 0.012)
    return tint((tone * np.where(gap, 0.66, 1.0)).astype(np.float32), colour)


def tiles(x: Plane, y: Plane, colour: Plane, rng: np.random.Generator) -> Picture:
    """Square tiles, 40 cm, with grout; every other one a shade darker."""
    column, row = np.floor(x / 0.4).astype(np.int_), np.floor(y / 0.4).astype(np.int_)
    cloud, grain = (noise((y.size, x.size), cell, rng) for cell in ((9, 14), (1, 1)))
    cloud = cloud * 0.02 + grain * 0.012
    tone = 1.0 + 0.035 * per_piece(column + 331 * row, rng) - 0.09 * ((column + row) % 2) + cloud
    picture = tint(tone.astype(np.float32), colour)
    picture[(np.mod(x, 0.4) < 0.012) | (np.mod(y, 0.4) < 0.012)] = colour * 0.7
    return picture


def carpet(x: Plane, y: Plane, colour: Plane, rng: np.random.Generator) -> Picture:
    """Carpet tiles, laid crosswise."""
    column, row = np.floor(x / 0.5).astype(np.int_), np.floor(y / 0.5).astype(np.int_)
    shape = (y.size, x.size)
    lengthwise, crosswise = noise(shape, (1, 9), rng), noise(shape, (9, 1), rng)
    weave = np.where((column + row) % 2 == 0, lengthwise, crosswise)
    tone = 1.0 + 0.07 * weave + 0.06 * noise(shape, (1, 1), rng) + 0.03 * ((column + row) % 2)
    return tint(tone.astype(np.float32), colour)


def screed(x: Plane, y: Plane, colour: Plane, rng: np.random.Generator) -> Picture:
    """A smooth grey floor."""
    shape = (y.size, x.size)
    return tint(1.0 + 0.02 * noise(shape, (1, 1), rng) + 0.05 * noise(shape, (50, 50), rng), colour)


FLOORS: dict[str, Material] = {
    "oak": oak,
    "tiles": tiles,
    "carpet": carpet,
    "concrete": screed,
}


def rug(
    width: float, depth: float, colour: Plane, density: float, rng: np.random.Generator
) -> Picture:
    """Return a rug (rows along depth, columns along width) with borders and lozenges."""
    rows, columns = max(2, round(depth * density)), max(2, round(width * density))
    y, x = np.mgrid[0:rows, 0:columns].astype(np.float32) / np.float32(density)
    edge = np.minimum(np.minimum(x, width - x), np.minimum(y, depth - y))
    lozenge = np.mod(np.abs(np.mod(x, 0.4) - 0.2) + np.abs(np.mod(y, 0.4) - 0.2), 0.2) < 0.06
    cream = rgb("#e6d6b8")
    picture = np.broadcast_to(colour, (rows, columns, 3)).copy()
    picture[lozenge] = colour * 0.72 + cream * 0.12
    picture[(edge > 0.10) & (edge < 0.17)] = cream
    picture[(edge > 0.12) & (edge < 0.15)] = colour * 0.6
    picture[edge < 0.03] = cream * 0.85
    grain = rng.standard_normal((rows, columns), dtype=np.float32)
    picture *= (1.0 + 0.06 * ndimage.uniform_filter(grain, 2))[..., None]
    return picture
