"""The appearance of furniture, docks, doors and robots: a few upright prisms with textures on their
sides. Collisions use the plain outlines of world/solids.py.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from robots.api.floorplan import ChargingDock, Door, DoorState, Furniture
from robots.api.geometry import Pose2D
from robots.simulator.render import textures as pictures
from robots.simulator.render.materials import WALLS, Picture, Plane, metres, rgb
from robots.world.robot_models import BodyPart
from robots.world.solids import Floats, disc, leaf_solid, rectangle, sides, station_pose

FINE, MIDDLE, COARSE = 100.0, 60.0, 30.0  # texels a metre
ROUND = 14
STEEL, DARK, WHITE = rgb("#9aa0a6"), rgb("#2b2e33"), rgb("#e9e7e1")

Painter = Callable[[int, int], Picture]
Span = tuple[float, float]
CENTRE = (0.0, 0.0)  # of a piece


@dataclass(frozen=True, eq=False)
class Block:
    """One or several prisms of the same height.

    `sides` (n, 4) are segments, counter-clockwise about each prism, `pictures` one a side. `lid` is
    the colour or the picture (rows, columns, 3) of the upper face, which only a single convex prism
    has; a picture's row 0 lies along the first side. `billboard`: one side, always turned to the
    viewer.
    """

    sides: Floats
    bottom: float
    top: float
    pictures: tuple[Picture, ...]
    lid: Plane | Picture | None = None
    density: float = MIDDLE
    billboard: bool = False
    glow: bool = False


def coat(
    material: str, colour: Plane, rng: np.random.Generator, density: float = MIDDLE
) -> Painter:
    """Return a painter that covers any face with a material."""

    def paint(columns: int, rows: int) -> Picture:
        return WALLS[material](*metres(columns, rows, density), colour, rng)

    return paint


def prism(
    outline: Floats,
    bottom: float,
    top: float,
    paint: Painter,
    *,
    front: Painter | None = None,
    lid: Plane | Picture | None = None,
    density: float = MIDDLE,
    glow: bool = False,
) -> Block:
    """Return a prism; `front` paints its first side, which looks to -y of its own frame."""
    faces = []
    for number, (x0, y0, x1, y1) in enumerate(sides(outline)):
        columns = max(1, round(math.hypot(x1 - x0, y1 - y0) * density))
        painter = front if front is not None and number == 0 else paint
        faces.append(painter(columns, max(1, round((top - bottom) * density))))
    return Block(sides(outline), bottom, top, tuple(faces), lid, density, glow=glow)


def together(blocks: list[Block]) -> Block:
    """Return prisms of the same height as one block, which is drawn at once; they get no lids."""
    joined = np.vstack([block.sides for block in blocks])
    faces = tuple(face for block in blocks for face in block.pictures)
    return replace(blocks[0], sides=joined, pictures=faces, lid=None)


class Joiner:
    """Builds blocks in a piece's frame: middle `at`, `span` from bottom to top, in metres."""

    def __init__(self, pose: Pose2D, rng: np.random.Generator) -> None:
        self.pose, self.rng = pose, rng
        self.blocks: list[Block] = []

    def box(
        self,
        at: Span,
        size: Span,
        span: Span,
        paint: Painter,
        *,
        front: Painter | None = None,
        lid: Plane | Picture | None = None,
        density: float = MIDDLE,
    ) -> Block:
        """Add a box, `size` wide and deep."""
        outline = rectangle(self.pose.compose(Pose2D(*at, 0.0)), *size)
        block = prism(outline, *span, paint, front=front, lid=lid, density=density)
        self.blocks.append(block)
        return block

    def drum(
        self,
        diameter: float,
        span: Span,
        paint: Painter,
        *,
        at: Span = (0.0, 0.0),
        lid: Plane | None = None,
        glow: bool = False,
    ) -> None:
        outline = disc(*self.pose.apply(*at), diameter, ROUND)
        self.blocks.append(prism(outline, *span, paint, lid=lid, density=COARSE, glow=glow))

    def legs(
        self, width: float, depth: float, height: float, thickness: float, paint: Painter
    ) -> None:
        """Add four legs, as one block."""
        x, y = (width - thickness) / 2.0, (depth - thickness) / 2.0
        corners = ((-x, -y), (-x, y), (x, -y), (x, y))
        size, span = (thickness, thickness), (0.0, height)
        made = [self.box(at, size, span, paint, density=COARSE) for at in corners]
        self.blocks = [block for block in self.blocks if block not in made]
        self.blocks.append(together(made))

    def slab(self, width: float, depth: float, bottom: float, top: float, colour: Plane) -> None:
        """Add a board of wood with its grain on top."""
        wood = coat("wood", colour, self.rng)
        grain = coat("wood", colour * np.float32(1.04), self.rng)(
            round(width * MIDDLE), round(depth * MIDDLE)
        ).swapaxes(0, 1)
        self.box(CENTRE, (width, depth), (bottom, top), wood, lid=grain)


def furnish(piece: Furniture, rng: np.random.Generator) -> list[Block]:
    joiner = Joiner(Pose2D(piece.x, piece.y, piece.theta), rng)
    BUILDERS[piece.kind](joiner, piece)
    return joiner.blocks


def _desk(j: Joiner, p: Furniture) -> None:
    colour, top = rgb(p.colour), p.height
    j.legs(p.width - 0.06, p.depth - 0.06, top - 0.04, 0.05, coat("plain", STEEL, j.rng))
    j.slab(p.width, p.depth, top - 0.04, top, colour)
    foot, keyboard = coat("plain", DARK, j.rng), coat("plain", DARK, j.rng)
    j.box((0.0, 0.12), (0.22, 0.16), (top, top + 0.015), foot, lid=DARK)
    j.box((0.0, -0.16), (0.44, 0.14), (top, top + 0.02), keyboard, lid=DARK * np.float32(1.3))
    dark, screen = coat("plain", DARK, j.rng), (top + 0.12, top + 0.47)
    j.box((0.0, 0.14), (0.05, 0.04), (top + 0.015, top + 0.12), dark)
    front = pictures.desktop
    j.box((0.0, 0.12), (0.58, 0.03), screen, dark, front=front, lid=DARK, density=FINE)


def _chair(j: Joiner, p: Furniture) -> None:
    colour = rgb(p.colour)
    cloth = coat("fabric", colour, j.rng)
    j.drum(p.width * 0.9, (0.03, 0.07), coat("plain", DARK, j.rng), lid=DARK)
    j.drum(0.06, (0.07, 0.43), coat("plain", STEEL, j.rng))
    j.drum(p.width * 0.92, (0.43, 0.51), cloth, lid=colour)
    j.box((0.0, p.width * 0.4), (p.width * 0.8, 0.05), (0.55, p.height), cloth, lid=colour)


def _sofa(j: Joiner, p: Furniture) -> None:
    colour = rgb(p.colour)
    cloth, lid = coat("fabric", colour, j.rng), colour * np.float32(1.05)
    arm, back, seat = 0.18, 0.22, 0.42
    inner, deep = p.width - 2.0 * arm, p.depth - back
    count = max(1, round(inner / 0.8))
    j.box(CENTRE, (p.width, p.depth), (0.06, 0.28), cloth, lid=colour)
    for number in range(count):
        at = (-inner / 2.0 + (number + 0.5) * inner / count, -back / 2.0)
        pillow = _pillow(colour, inner / count, deep, j.rng)
        j.box(at, (inner / count - 0.02, deep), (0.28, seat), cloth, lid=pillow)
    j.box((0.0, deep / 2.0), (p.width, back), (0.28, p.height), cloth, lid=lid)
    for side in (-1.0, 1.0):
        at = (side * (p.width - arm) / 2.0, -back / 2.0)
        j.box(at, (arm, deep), (0.28, 0.6), cloth, lid=lid)


def _pillow(colour: Plane, width: float, depth: float, rng: np.random.Generator) -> Picture:
    columns, rows = max(2, round(width * MIDDLE)), max(2, round(depth * MIDDLE))
    x, y = pictures.grid(columns, rows)
    edge = np.minimum(np.minimum(x, 1.0 - x) * width, np.minimum(y, 1.0 - y) * depth)
    shade = (1.06 - 0.3 * np.exp(-edge / 0.04))[..., None]
    picture = coat("fabric", colour, rng)(columns, rows) * shade
    turned: Picture = picture.astype(np.float32).swapaxes(0, 1)
    return turned


def _table(j: Joiner, p: Furniture) -> None:
    colour = rgb(p.colour)
    wood = coat("wood", colour * np.float32(0.8), j.rng)
    j.legs(p.width - 0.08, p.depth - 0.08, p.height - 0.04, 0.05, wood)
    j.slab(p.width, p.depth, p.height - 0.04, p.height, colour)


def _bookcase(j: Joiner, p: Furniture) -> None:
    colour = rgb(p.colour)

    def front(columns: int, rows: int) -> Picture:
        return pictures.books(columns, rows, colour, FINE, j.rng)

    wood, span = coat("wood", colour, j.rng, FINE), (0.0, p.height)
    j.box(CENTRE, (p.width, p.depth), span, wood, front=front, lid=colour, density=FINE)


def _cabinet(j: Joiner, p: Furniture) -> None:
    colour, top = rgb(p.colour), p.height - 0.03

    def front(columns: int, rows: int) -> Picture:
        return pictures.cupboard(columns, rows, colour, MIDDLE, j.rng)

    j.box(CENTRE, (p.width, p.depth), (0.0, top), coat("plain", colour, j.rng), front=front)
    j.slab(p.width + 0.02, p.depth + 0.02, top, p.height, rgb("#b98d5d"))


def _plant(j: Joiner, p: Furniture) -> None:
    pot = 0.30
    clay = coat("plain", rgb("#c9c3b8"), j.rng)
    j.drum(p.width * 0.78, (0.0, pot), clay, lid=rgb("#3b2c20"))
    width = p.width * 2.1
    columns, rows = round(width * FINE), round((p.height - pot + 0.04) * FINE)
    leaves = pictures.foliage(columns, rows, rgb(p.colour), j.rng)
    x, y = j.pose.x, j.pose.y
    side = np.array([[x - width / 2.0, y, x + width / 2.0, y]])
    j.blocks.append(Block(side, pot - 0.04, p.height, (leaves,), None, FINE, billboard=True))


def _lamp(j: Joiner, p: Furniture) -> None:
    j.drum(p.width * 0.8, (0.0, 0.03), coat("plain", DARK, j.rng), lid=DARK)
    j.drum(0.035, (0.03, p.height - 0.28), coat("plain", DARK, j.rng))
    shade = coat("plain", rgb(p.colour), j.rng)
    j.drum(p.width, (p.height - 0.3, p.height), shade, lid=rgb("#fff3cf"), glow=True)


def _bench(j: Joiner, p: Furniture) -> None:
    j.legs(p.width - 0.1, p.depth - 0.04, p.height - 0.05, 0.06, coat("plain", DARK, j.rng))
    j.slab(p.width, p.depth, p.height - 0.05, p.height, rgb(p.colour))


def _box(j: Joiner, p: Furniture) -> None:
    colour = rgb(p.colour)
    paint = coat("plain", colour, j.rng)
    j.box(CENTRE, (p.width, p.depth), (0.0, p.height), paint, lid=colour)


def _cylinder(j: Joiner, p: Furniture) -> None:
    colour = rgb(p.colour)
    j.drum(p.width, (0.0, p.height), coat("plain", colour, j.rng), lid=colour)


BUILDERS: dict[str, Callable[[Joiner, Furniture], None]] = {
    "desk": _desk,
    "chair": _chair,
    "sofa": _sofa,
    "armchair": _sofa,
    "table": _table,
    "bookcase": _bookcase,
    "cabinet": _cabinet,
    "plant": _plant,
    "lamp": _lamp,
    "bench": _bench,
    "television": _cabinet,
    "box": _box,
    "cylinder": _cylinder,
}


def dock_blocks(dock: ChargingDock, seed: int) -> list[Block]:
    """Return a charging station: its body, and a marker at the height of a camera."""
    rng = np.random.default_rng(seed)
    pose = station_pose(dock)
    # its front looks at the robot
    joiner = Joiner(Pose2D(pose.x, pose.y, pose.theta - math.pi / 2.0), rng)
    body = dock.station
    size, grey = (body.width, body.depth), rgb("#6a7178")
    dark, front = coat("plain", rgb("#3a4046"), rng), pictures.station
    joiner.box(CENTRE, size, (0.0, body.height), dark, front=front, lid=grey, density=FINE)

    def plate(columns: int, rows: int) -> Picture:
        return pictures.marker(columns, rows, seed)

    at, span = (0.0, body.depth / 2.0 - 0.02), (body.height + 0.1, body.height + 0.6)
    white = coat("plain", WHITE, rng)
    joiner.box(at, (0.5, 0.03), span, white, front=plate, lid=WHITE, density=FINE)
    return joiner.blocks


def leaf_block(door: Door, state: DoorState, rng: np.random.Generator) -> Block:
    colour, rows = rgb(door.colour), round(door.height * FINE)
    faces = []
    segments = sides(leaf_solid(door, state).outline)
    for number, side in enumerate(segments):
        columns = max(1, round(math.dist(side[:2], side[2:]) * FINE))
        if number % 2 == 0:
            left = number == 2
            faces.append(pictures.door_leaf(columns, rows, colour, FINE, rng, handle_left=left))
        else:
            faces.append(pictures.canvas(columns, rows, colour * np.float32(0.85)))
    return Block(segments, 0.005, door.height, tuple(faces), colour, FINE)


def body_blocks(parts: tuple[BodyPart, ...], rng: np.random.Generator) -> list[Block]:
    """Return a robot's body about the origin, its nose along x."""
    # a block's front looks to its -y: to the robot's +x
    joiner = Joiner(Pose2D(0.0, 0.0, math.pi / 2.0), rng)
    for part in parts:
        colour, at, span = rgb(part.colour), (part.y, -part.x), (part.bottom, part.top)
        paint = coat("plain", colour, rng)
        if part.shape == "cylinder":
            joiner.drum(part.width, span, paint, at=at, lid=colour)
        else:
            front = pictures.robot_face if part.face == "screen" else None
            size = (part.depth, part.width)
            joiner.box(at, size, span, paint, front=front, lid=colour, density=FINE)
    return joiner.blocks
