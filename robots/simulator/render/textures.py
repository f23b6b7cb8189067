"""A catalogue of what hangs on walls, and of the fronts of things: windows, paintings, clocks, book
spines, a charging station's marker.

Every function returns a texture (columns, rows, 3) float32 like a wall's (see materials.py) for a
width and a height in texels: column 0 is at the viewer's left, row 0 at the bottom.
"""

from collections.abc import Callable

import numpy as np

from robots.simulator.render.bitmap_font import letters
from robots.simulator.render.materials import Picture, Plane, metres, noise, plain, rgb, wood

PALETTES = (
    ("#1f3a5f", "#e3b04b", "#f4efe6", "#c8553d"),
    ("#2d4739", "#d9a05b", "#f1e3c6", "#7c9a6b"),
    ("#4a2c40", "#e9806e", "#f3d8c7", "#7d5ba6"),
    ("#0f4c5c", "#e36414", "#fb8b24", "#f6e7cb"),
    ("#283618", "#dda15e", "#fefae0", "#bc6c25"),
    ("#22223b", "#c9ada7", "#f2e9e4", "#9a8c98"),
)


SPINES = (
    *("#7b2d26", "#2f4858", "#c79a3b", "#4a6741", "#8e6c88"),
    *("#d8cdb4", "#35524a", "#a4522d", "#1f2f46", "#b8b0a0"),
)


def grid(columns: int, rows: int) -> tuple[Plane, Plane]:
    """Return coordinates from 0 to 1 as (columns, 1) to the right and (1, rows) upwards."""
    across: Plane = (np.arange(columns, dtype=np.float32) + np.float32(0.5)) / np.float32(columns)
    up: Plane = (np.arange(rows, dtype=np.float32) + np.float32(0.5)) / np.float32(rows)
    return across[:, None], up[None, :]


def canvas(columns: int, rows: int, colour: Plane) -> Picture:
    return np.broadcast_to(colour, (columns, rows, 3)).astype(np.float32)


def gradient(x: Plane, y: Plane, bottom: str, top: str) -> Picture:
    """Return a texture over a `grid` whose colour changes from the bottom to the top."""
    up = y[..., None]
    blend: Picture = rgb(top) * up + rgb(bottom) * (1.0 - up) + 0.0 * x[..., None]
    return blend


def frame(picture: Picture, thickness: int, colour: Plane) -> None:
    """Put a frame around a picture, lighter above and left of its edge."""
    t = max(1, thickness)
    for part, light in (
        (picture[:, :t], 0.8),
        (picture[:, -t:], 1.12),
        (picture[:t], 1.0),
        (picture[-t:], 0.9),
    ):
        part[...] = colour * light


def painting(columns: int, rows: int, variant: int, rng: np.random.Generator) -> Picture:
    """A landscape, or an abstract one, in a frame with a mat."""
    palette = [rgb(colour) for colour in PALETTES[variant % len(PALETTES)]]
    x, y = grid(columns, rows)
    art = _landscape(x, y, palette, rng) if variant % 2 else _abstract(x, y, palette, rng)
    art *= (1.0 + 0.05 * noise((columns, rows), (2, 2), rng))[..., None]
    mat = max(3, round(min(columns, rows) * 0.12))
    picture = canvas(columns, rows, rgb("#f3efe4"))
    picture[mat:-mat, mat:-mat] = art[mat:-mat, mat:-mat]
    wood = rgb(("#3b2b20", "#1d1d1f", "#a9844f")[variant % 3])
    frame(picture, max(2, round(min(columns, rows) * 0.05)), wood)
    return picture


def _landscape(x: Plane, y: Plane, palette: list[Plane], rng: np.random.Generator) -> Picture:
    art = palette[2] * y[..., None] + palette[1] * (1.0 - y[..., None]) + 0.0 * x[..., None]
    sun = (x - 0.68) ** 2 * 2.0 + (y - 0.66) ** 2 < 0.012
    art[sun] = (1.0, 0.93, 0.75)
    for layer in range(4):
        phase = rng.uniform(0.0, 6.28, 3)
        ridge = (
            0.55
            - 0.13 * layer
            + 0.06 * np.sin(5.0 * x + phase[0])
            + 0.03 * np.sin(13.0 * x + phase[1])
            + 0.012 * np.sin(31.0 * x + phase[2])
        )
        shade = layer / 3.0
        art[y < ridge] = palette[3] * (1.0 - shade) * 0.95 + palette[0] * shade
    return art.astype(np.float32)


def _abstract(x: Plane, y: Plane, palette: list[Plane], rng: np.random.Generator) -> Picture:
    art = canvas(x.size, y.size, palette[2])
    for number in range(9):
        cx, cy, size = rng.uniform(0.1, 0.9), rng.uniform(0.1, 0.9), rng.uniform(0.08, 0.3)
        colour = palette[(number * 3) % 4] * rng.uniform(0.85, 1.1)
        if number % 3 == 0:
            art[(x - cx) ** 2 + (y - cy) ** 2 < size**2 * 0.6] = colour
        elif number % 3 == 1:
            art[(np.abs(x - cx) < size) & (np.abs(y - cy) < size * 0.45)] = colour
        else:
            art[np.abs(y - cy - 0.5 * np.sin(3.0 * (x - cx))) < 0.02] = colour
    return np.clip(art, 0.0, 1.0)


def window(columns: int, rows: int, variant: int, rng: np.random.Generator) -> Picture:
    """Daylight: sky, clouds, hills and trees behind four panes."""
    x, y = grid(columns, rows)
    picture = gradient(x, y, "#eaf4fb", "#8fc1ea")
    puffs = noise((columns, rows), (columns / 4, rows / 7), rng) * 0.7 + 0.15
    cloud = np.clip(puffs, 0.0, 1.0) * np.clip((y - 0.3) * 3.0, 0.0, 1.0)
    picture += (1.0 - picture) * cloud[..., None]
    phase = variant * 1.7
    hills = 0.36 + 0.05 * np.sin(5.0 * x + phase) + 0.02 * np.sin(17.0 * x + 2.0 * phase)
    picture[y < hills] = rgb("#a9c7a0")
    trees = 0.24 + 0.03 * np.abs(np.sin(21.0 * x + phase)) + 0.02 * np.abs(np.sin(47.0 * x))
    picture[y < trees + 0.0 * x] = rgb("#6f9a63")
    picture[y < 0.12 + 0.0 * x] = rgb("#8bb374")
    crowns = (y < trees) & (y > 0.12)
    picture[crowns] *= (1.0 + 0.12 * noise((columns, rows), (3, 3), rng))[crowns][:, None]
    bar = max(2, columns // 36)
    white = rgb("#f7f5ef")
    middle, half = columns // 2, rows // 2
    picture[middle - bar // 2 : middle + bar // 2 + 1] = white
    picture[:, half - bar // 2 : half + bar // 2 + 1] = white * 0.96
    frame(picture, round(bar * 1.8), white)
    picture[:, : round(bar * 1.2)] = white * 0.82
    return np.clip(picture, 0.0, 1.0).astype(np.float32)


def whiteboard(columns: int, rows: int, variant: int, rng: np.random.Generator) -> Picture:
    """Plans, arrows and a graph, in three pens."""
    x, y = grid(columns, rows)
    picture = canvas(columns, rows, rgb("#fbfbf8"))
    pens = [rgb("#2456a6"), rgb("#b3322b"), rgb("#27753b")]
    for line in range(5):
        level, end = 0.82 - 0.075 * line, rng.uniform(0.22, 0.4)
        wave = 0.008 * np.sin(190.0 * x + 31.0 * line) * np.sin(43.0 * x)
        written = (np.abs(y - level - wave) < 0.008) & (x > 0.07) & (x < end)
        picture[written] = pens[(line + variant) % 3]
    for number in range(3):
        cx, cy = 0.56 + 0.15 * number, 0.7 - 0.16 * (number % 2)
        box = np.maximum(np.abs(x - cx) / 0.05, np.abs(y - cy) / 0.09)
        picture[(box < 1.0) & (box > 0.88)] = pens[number]
    picture[(np.abs(y - 0.6) < 0.007) & (x > 0.6) & (x < 0.66)] = pens[0]
    curve = 0.12 + 0.25 * (1.0 - np.exp(-4.0 * (x - 0.1))) + 0.01 * np.sin(60.0 * x)
    picture[(np.abs(y - curve) < 0.01) & (x > 0.1) & (x < 0.45)] = pens[1]
    picture[(np.abs(x - 0.1) < 0.003) & (y > 0.1) & (y < 0.45)] = rgb("#333333")
    picture[(np.abs(y - 0.1) < 0.006) & (x > 0.1) & (x < 0.47)] = rgb("#333333")
    frame(picture, max(2, columns // 70), rgb("#aeb4b8"))
    return picture


def poster(columns: int, rows: int, variant: int, rng: np.random.Generator) -> Picture:
    """A bold shape over lines of text."""
    palette = [rgb(colour) for colour in PALETTES[(variant * 2 + 1) % len(PALETTES)]]
    x, y = grid(columns, rows)
    picture = canvas(columns, rows, palette[2])
    picture[y + 0.0 * x > 0.32] = palette[0]
    centre = (x - 0.5) ** 2 * (columns / rows) ** 2 + (y - 0.66) ** 2
    picture[centre < 0.045] = palette[1]
    picture[centre < 0.022] = palette[3]
    picture[(np.abs(y - 0.66 - 0.25 * (x - 0.5)) < 0.025) & (centre < 0.1)] = palette[2]
    for line in range(4):
        half = 0.018 if line == 0 else 0.008
        printed = (np.abs(y - 0.24 + 0.05 * line) < half) & (x > 0.1) & (x < rng.uniform(0.6, 0.9))
        picture[printed] = palette[0]
    frame(picture, 1, rgb("#ddd8cc"))
    return picture


def clock(columns: int, rows: int, variant: int, rng: np.random.Generator) -> Picture:
    """Ten past ten, as in the shop; corners are NaN: transparent."""
    del variant, rng
    x, y = grid(columns, rows)
    dx, dy = 2.0 * x - 1.0, 2.0 * y - 1.0
    radius, angle = np.hypot(dx, dy), np.arctan2(dx, dy + 0.0 * dx)
    picture = canvas(columns, rows, rgb("#fbfaf5"))
    hours = np.abs(np.mod(angle * 6.0 / np.pi + 0.5, 1.0) - 0.5)
    picture[(hours < 0.09) & (radius > 0.72) & (radius < 0.84)] = rgb("#222222")
    for turn, length, width in ((-1.0, 0.5, 0.055), (1.05, 0.7, 0.04)):
        along, aside = dx * np.sin(turn) + dy * np.cos(turn), dx * np.cos(turn) - dy * np.sin(turn)
        picture[(np.abs(aside) < width) & (along > -0.08) & (along < length)] = rgb("#222222")
    picture[radius > 0.88] = rgb("#39424a")
    picture[radius > 1.0] = np.nan
    return picture


def sign(columns: int, rows: int, text: str) -> Picture:
    """White capitals on dark blue."""
    picture = canvas(columns, rows, rgb("#274690"))
    ink = letters(text)
    size = max(1, min(columns * 8 // 10 // ink.shape[1], rows * 6 // 10 // ink.shape[0]))
    dots = np.kron(ink, np.ones((size, size), dtype=np.bool_))[::-1].T
    left, low = (columns - dots.shape[0]) // 2, (rows - dots.shape[1]) // 2
    if left >= 0 and low >= 0:
        picture[left : left + dots.shape[0], low : low + dots.shape[1]][dots] = rgb("#f7f7f2")
    frame(picture, 1, rgb("#e8e8e2"))
    return picture


def screen(columns: int, rows: int, variant: int, rng: np.random.Generator) -> Picture:
    """A television that shows a sea at dusk."""
    del variant
    x, y = grid(columns, rows)
    picture = gradient(x, y, "#f2a65a", "#35507d")
    picture[(x - 0.5) ** 2 * 3.2 + (y - 0.42) ** 2 < 0.012] = rgb("#ffe9b0")
    sea = y + 0.0 * x < 0.4
    picture[sea] = (rgb("#274b6d") * (0.75 + 0.7 * y[..., None]) + 0.0 * x[..., None])[sea]
    waves = noise((columns, rows), (4, 1.2), rng) > 0.4
    picture[sea & (np.abs(x - 0.5) < 0.08 + 0.25 * (0.4 - y)) & waves] = rgb("#f6cf8d")
    frame(picture, max(2, columns // 60), rgb("#141416"))
    return picture


def desktop(columns: int, rows: int) -> Picture:
    """A computer's screen with windows on it."""
    x, y = grid(columns, rows)
    picture = gradient(x, y, "#173552", "#2c5d8a")
    for left, right, low, high in ((0.08, 0.55, 0.2, 0.88), (0.5, 0.92, 0.12, 0.62)):
        inside = (x > left) & (x < right) & (y > low) & (y < high)
        picture[inside] = rgb("#f4f6f8")
        picture[inside & (y > high - 0.07)] = rgb("#c3ccd6")
        lines = (np.mod(y, 0.07) < 0.025) & (y < high - 0.1)
        picture[inside & lines & (x > left + 0.03) & (x < right - 0.08)] = rgb("#7d8a99")
    frame(picture, 1, rgb("#101214"))
    return picture


def robot_face(columns: int, rows: int) -> Picture:
    """The robot's display as a mirror shows it: the call's blue, and a friendly face."""
    x, y = grid(columns, rows)
    picture: Picture = rgb("#2b6cb0") * (0.75 + 0.35 * y[..., None]) + 0.0 * x[..., None]
    dx, dy = (x - 0.5) * (columns / rows), y - 0.52
    head = np.hypot(dx, dy) < 0.3
    picture[head] = rgb("#ffd9a8")
    for eye in (-0.11, 0.11):
        picture[np.hypot(dx - eye, dy - 0.07) < 0.04] = rgb("#25303b")
    mouth = (np.abs(np.hypot(dx, dy + 0.0) - 0.17) < 0.025) & (dy < -0.06)
    picture[mouth] = rgb("#a8483a")
    frame(picture, max(1, columns // 16), rgb("#15181c"))
    return picture


def books(
    columns: int, rows: int, colour: Plane, density: float, rng: np.random.Generator
) -> Picture:
    """A bookcase's front: shelves, and spines of many colours."""
    picture: Picture = wood(*metres(columns, rows, density), colour, rng) * np.float32(0.45)
    shelf, board = round(0.34 * density), max(2, round(0.025 * density))
    for bottom in range(round(0.06 * density), rows - board, shelf):
        at = board + 1
        while at < columns - board - 4:
            wide, high = int(rng.integers(3, 8)), int(shelf * rng.uniform(0.6, 0.88))
            if rng.random() < 0.12:
                at += wide * 2  # a gap
                continue
            spine = rgb(SPINES[int(rng.integers(len(SPINES)))]) * rng.uniform(0.85, 1.1)
            top = min(bottom + high, rows - board)
            right = min(at + wide, columns - board)
            picture[at:right, bottom:top] = spine
            picture[at : at + 1, bottom:top] = spine * 0.7
            picture[at:right, bottom + high // 2 : bottom + high // 2 + 2] = spine * 1.3
            at += wide
        picture[:, bottom - board : bottom] = colour * 1.05
    frame(picture, board, colour)
    clipped: Picture = np.clip(picture, 0.0, 1.0)
    return clipped


def cupboard(
    columns: int, rows: int, colour: Plane, density: float, rng: np.random.Generator
) -> Picture:
    """Doors with handles."""
    picture = plain(*metres(columns, rows, density), colour, rng)
    doors = max(1, round(columns / density / 0.5))
    for number in range(doors + 1):
        at = min(columns - 1, number * columns // doors)
        picture[max(0, at - 1) : at + 1] *= 0.55
    for number in range(doors):
        fifths = 4 if number % 2 == 0 else 1
        handle = (number * columns // doors) + (columns // doors) * fifths // 5
        picture[handle : handle + 2, rows // 2 : rows // 2 + max(4, rows // 7)] = rgb("#4b4f54")
    picture[:, : max(2, round(0.05 * density))] *= 0.5
    return picture


def door_leaf(
    columns: int,
    rows: int,
    colour: Plane,
    density: float,
    rng: np.random.Generator,
    *,
    handle_left: bool,
) -> Picture:
    """A panelled door with a handle."""
    picture = wood(*metres(columns, rows, density), colour, rng)
    x, y = grid(columns, rows)
    for low, high in ((0.08, 0.44), (0.52, 0.94)):
        above = np.abs(y - (low + high) / 2.0) / ((high - low) / 2.0)
        edge = np.maximum(np.abs(x - 0.5) / 0.34, above)
        picture[(edge < 1.0) & (edge > 0.93)] *= 0.7
        picture[edge <= 0.93] *= 1.06
    at, plate = (0.1, 0.03) if handle_left else (0.9, -0.03)
    picture[(np.abs(x - at) < 0.045) & (np.abs(y - 0.48) < 0.008)] = rgb("#d7d9db")
    picture[(np.abs(x - at + plate) < 0.012) & (np.abs(y - 0.48) < 0.04)] = rgb("#b9bcc0")
    return np.clip(picture, 0.0, 1.0)


def marker(columns: int, rows: int, seed: int) -> Picture:
    """A charging station's sign: 6 x 6 in black and white that identify the station."""
    bits = np.random.default_rng(seed).integers(0, 2, (4, 4)).astype(np.bool_)
    pattern = np.zeros((6, 6), dtype=np.float32)
    pattern[1:5, 1:5] = bits
    picture = canvas(columns, rows, rgb("#f5f5f2"))
    side = round(min(columns, rows) * 0.8)
    left, low = (columns - side) // 2, (rows - side) // 2
    index = (np.arange(side) * 6) // side
    squares = (0.06 + 0.9 * pattern[index][:, index])[..., None]
    picture[left : left + side, low : low + side] = squares
    return picture


def station(columns: int, rows: int) -> Picture:
    """The front of a charging station: contacts, a green light, hazard stripes at its foot."""
    x, y = grid(columns, rows)
    picture: Picture = rgb("#3a4046") * (0.9 + 0.25 * y[..., None]) + 0.0 * x[..., None]
    picture[(np.mod(x * columns / 9.0 + y * rows / 9.0, 2.0) < 1.0) & (y < 0.16)] = rgb("#e8b923")
    for contact in (0.38, 0.62):
        picture[(np.abs(x - contact) < 0.05) & (np.abs(y - 0.42) < 0.1)] = rgb("#d9a441")
    picture[(np.abs(x - 0.5) < 0.3) & (np.abs(y - 0.86) < 0.035)] = rgb("#59e07a")
    return picture


def foliage(columns: int, rows: int, colour: Plane, rng: np.random.Generator) -> Picture:
    """Leaves; NaN is transparent."""
    x, y = grid(columns, rows)
    picture = np.full((columns, rows, 3), np.nan, dtype=np.float32)
    for number in range(46):
        share = number / 45.0
        angle = rng.uniform(-1.25, 1.25) * (1.0 - 0.35 * share)
        length = rng.uniform(0.35, 0.62)
        tip_x = 0.5 + 0.62 * length * np.sin(angle)
        tip_y = 0.08 + share * 0.42 + length * np.cos(angle) * 0.72
        base_x, base_y = 0.5, 0.02 + 0.3 * share
        ax, ay = tip_x - base_x, tip_y - base_y
        along = ((x - base_x) * ax + (y - base_y) * ay) / (ax * ax + ay * ay)
        aside = np.abs((x - base_x) * ay - (y - base_y) * ax) / np.hypot(ax, ay)
        half = 0.055 * np.sin(np.pi * np.clip(along, 0.02, 1.0) ** 0.7) + 0.004
        leaf = (along > 0.0) & (along < 1.0) & (aside < half)
        shade = rng.uniform(0.6, 1.15) * (0.7 + 0.4 * share)
        picture[leaf] = np.clip(colour * shade + (0.02, 0.03, 0.0), 0.0, 1.0)
        picture[leaf & (aside < 0.008)] = np.clip(colour * shade * 1.3, 0.0, 1.0)
    return picture


HANGING: dict[str, Callable[[int, int, int, np.random.Generator], Picture]] = {
    "picture": painting,
    "window": window,
    "whiteboard": whiteboard,
    "poster": poster,
    "clock": clock,
    "screen": screen,
}
