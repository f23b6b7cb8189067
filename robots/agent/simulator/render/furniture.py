"""Things for the camera: every piece of furniture as a few upright prisms with pictures on their
sides.

What the robot bumps into is the plain outline of world/solids.py; this is only what it looks like.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from robots.agent.simulator.render import textures as pictures
from robots.agent.simulator.render.materials import WALLS, Picture, Plane, rgb
from robots.api.floorplan import ChargingDock, Door, DoorState, Furniture
from robots.api.geometry import Pose2D
from robots.world.robot_models import BodyPart
from robots.world.solids import Floats, disc, leaf_end, rectangle, station_pose

FINE, MIDDLE, COARSE = 100.0, 60.0, 30.0  # texels a metre
ROUND = 14
STEEL, DARK, WHITE = rgb("#9aa0a6"), rgb("#2b2e33"), rgb("#e9e7e1")

Painter = Callable[[int, int], Picture]


@dataclass(frozen=True, eq=False)
class Block:
    """One or several prisms of the same height.

    `sides` (n, 4) are segments, counter-clockwise about each prism, `pictures` one a side. `lid` is
    the colour or the picture (rows, columns, 3) of the upper face, which only a single convex prism
    has; a picture's row 0 lies along the first side. `billboard`: one side, always turned to who
    looks.
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
        u = (np.arange(columns, dtype=np.float32) + np.float32(0.5))[:, None] / np.float32(density)
        z = (np.arange(rows, dtype=np.float32) + np.float32(0.5))[None, :] / np.float32(density)
        return WALLS[material](u, z, colour, rng)

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
    sides = np.hstack([outline, np.roll(outline, -1, axis=0)])
    rows = max(1, round((top - bottom) * density))
    faces = []
    for number, (x0, y0, x1, y1) in enumerate(sides):
        columns = max(1, round(math.hypot(x1 - x0, y1 - y0) * density))
        painter = front if front is not None and number == 0 else paint
        faces.append(painter(columns, rows))
    return Block(sides, bottom, top, tuple(faces), lid, density, glow=glow)


def together(blocks: list[Block]) -> Block:
    """Return prisms of the same height as one block, which is drawn at once; they get no lids."""
    first = blocks[0]
    faces = tuple(face for block in blocks for face in block.pictures)
    return Block(
        np.vstack([block.sides for block in blocks]),
        first.bottom,
        first.top,
        faces,
        None,
        first.density,
    )


class Joiner:
    """Builds blocks in the frame of one piece."""

    def __init__(self, pose: Pose2D, rng: np.random.Generator) -> None:
        self.pose, self.rng = pose, rng
        self.blocks: list[Block] = []

    def box(
        self,
        x: float,
        y: float,
        width: float,
        depth: float,
        bottom: float,
        top: float,
        paint: Painter,
        *,
        front: Painter | None = None,
        lid: Plane | Picture | None = None,
        density: float = MIDDLE,
    ) -> Block:
        """Add a box."""
        outline = rectangle(self.pose.compose(Pose2D(x, y, 0.0)), width, depth)
        self.blocks.append(
            prism(outline, bottom, top, paint, front=front, lid=lid, density=density)
        )
        return self.blocks[-1]

    def drum(
        self,
        x: float,
        y: float,
        diameter: float,
        bottom: float,
        top: float,
        paint: Painter,
        *,
        lid: Plane | None = None,
        glow: bool = False,
    ) -> Block:
        """Add a cylinder."""
        centre = self.pose.apply(x, y)
        self.blocks.append(
            prism(
                disc(*centre, diameter, ROUND),
                bottom,
                top,
                paint,
                lid=lid,
                density=COARSE,
                glow=glow,
            )
        )
        return self.blocks[-1]

    def legs(
        self, width: float, depth: float, height: float, thickness: float, paint: Painter
    ) -> None:
        """Add four legs, as one block."""
        made = [
            self.box(
                sx * (width - thickness) / 2.0,
                sy * (depth - thickness) / 2.0,
                thickness,
                thickness,
                0.0,
                height,
                paint,
                density=COARSE,
            )
            for sx in (-1.0, 1.0)
            for sy in (-1.0, 1.0)
        ]
        self.blocks = [block for block in self.blocks if block not in made]
        self.blocks.append(together(made))

    def slab(self, width: float, depth: float, bottom: float, top: float, colour: Plane) -> None:
        """Add a board of wood with its grain on top."""
        wood = coat("wood", colour, self.rng)
        grain = coat("wood", colour * np.float32(1.04), self.rng)(
            round(width * MIDDLE), round(depth * MIDDLE)
        ).swapaxes(0, 1)
        self.box(0.0, 0.0, width, depth, bottom, top, wood, lid=grain)


def furnish(piece: Furniture, rng: np.random.Generator) -> list[Block]:
    """Return what a piece of furniture looks like."""
    joiner = Joiner(Pose2D(piece.x, piece.y, piece.theta), rng)
    BUILDERS[piece.kind](joiner, piece)
    return joiner.blocks


def _desk(j: Joiner, p: Furniture) -> None:
    colour = rgb(p.colour)
    j.legs(p.width - 0.06, p.depth - 0.06, p.height - 0.04, 0.05, coat("plain", STEEL, j.rng))
    j.slab(p.width, p.depth, p.height - 0.04, p.height, colour)
    j.box(0.0, 0.12, 0.22, 0.16, p.height, p.height + 0.015, coat("plain", DARK, j.rng), lid=DARK)
    j.box(
        0.0,
        -0.16,
        0.44,
        0.14,
        p.height,
        p.height + 0.02,
        coat("plain", DARK, j.rng),
        lid=DARK * np.float32(1.3),
    )
    dark = coat("plain", DARK, j.rng)
    j.box(0.0, 0.14, 0.05, 0.04, p.height + 0.015, p.height + 0.12, dark)
    j.box(
        0.0,
        0.12,
        0.58,
        0.03,
        p.height + 0.12,
        p.height + 0.47,
        dark,
        front=pictures.desktop,
        lid=DARK,
        density=FINE,
    )


def _chair(j: Joiner, p: Furniture) -> None:
    colour = rgb(p.colour)
    cloth = coat("fabric", colour, j.rng)
    j.drum(0.0, 0.0, p.width * 0.9, 0.03, 0.07, coat("plain", DARK, j.rng), lid=DARK)
    j.drum(0.0, 0.0, 0.06, 0.07, 0.43, coat("plain", STEEL, j.rng))
    j.drum(0.0, 0.0, p.width * 0.92, 0.43, 0.51, cloth, lid=colour)
    j.box(0.0, p.width * 0.4, p.width * 0.8, 0.05, 0.55, p.height, cloth, lid=colour)


def _sofa(j: Joiner, p: Furniture) -> None:
    colour = rgb(p.colour)
    cloth = coat("fabric", colour, j.rng)
    arm, back, seat = 0.18, 0.22, 0.42
    inner = p.width - 2.0 * arm
    count = max(1, round(inner / 0.8))
    j.box(0.0, 0.0, p.width, p.depth, 0.06, 0.28, cloth, lid=colour)
    for number in range(count):
        x = -inner / 2.0 + (number + 0.5) * inner / count
        j.box(
            x,
            -back / 2.0,
            inner / count - 0.02,
            p.depth - back,
            0.28,
            seat,
            cloth,
            lid=_pillow(colour, inner / count, p.depth - back, j.rng),
        )
    j.box(
        0.0,
        (p.depth - back) / 2.0,
        p.width,
        back,
        0.28,
        p.height,
        cloth,
        lid=colour * np.float32(1.05),
    )
    for side in (-1.0, 1.0):
        j.box(
            side * (p.width - arm) / 2.0,
            -back / 2.0,
            arm,
            p.depth - back,
            0.28,
            0.6,
            cloth,
            lid=colour * np.float32(1.05),
        )


def _pillow(colour: Plane, width: float, depth: float, rng: np.random.Generator) -> Picture:
    columns, rows = max(2, round(width * MIDDLE)), max(2, round(depth * MIDDLE))
    x, y = pictures.grid(columns, rows)
    edge = np.minimum(np.minimum(x, 1.0 - x) * width, np.minimum(y, 1.0 - y) * depth)
    picture = (
        coat("fabric", colour, rng)(columns, rows) * (1.06 - 0.3 * np.exp(-edge / 0.04))[..., None]
    )
    turned: Picture = picture.astype(np.float32).swapaxes(0, 1)
    return turned


def _table(j: Joiner, p: Furniture) -> None:
    colour = rgb(p.colour)
    j.legs(
        p.width - 0.08,
        p.depth - 0.08,
        p.height - 0.04,
        0.05,
        coat("wood", colour * np.float32(0.8), j.rng),
    )
    j.slab(p.width, p.depth, p.height - 0.04, p.height, colour)


def _bookcase(j: Joiner, p: Furniture) -> None:
    colour = rgb(p.colour)

    def front(columns: int, rows: int) -> Picture:
        return pictures.books(columns, rows, colour, FINE, j.rng)

    j.box(
        0.0,
        0.0,
        p.width,
        p.depth,
        0.0,
        p.height,
        coat("wood", colour, j.rng, FINE),
        front=front,
        lid=colour,
        density=FINE,
    )


def _cabinet(j: Joiner, p: Furniture) -> None:
    colour = rgb(p.colour)

    def front(columns: int, rows: int) -> Picture:
        return pictures.cupboard(columns, rows, colour, MIDDLE, j.rng)

    j.box(
        0.0, 0.0, p.width, p.depth, 0.0, p.height - 0.03, coat("plain", colour, j.rng), front=front
    )
    j.slab(p.width + 0.02, p.depth + 0.02, p.height - 0.03, p.height, rgb("#b98d5d"))


def _plant(j: Joiner, p: Furniture) -> None:
    pot = 0.30
    j.drum(
        0.0, 0.0, p.width * 0.78, 0.0, pot, coat("plain", rgb("#c9c3b8"), j.rng), lid=rgb("#3b2c20")
    )
    width = p.width * 2.1
    leaves = pictures.foliage(
        round(width * FINE), round((p.height - pot + 0.04) * FINE), rgb(p.colour), j.rng
    )
    x, y = j.pose.x, j.pose.y
    side = np.array([[x - width / 2.0, y, x + width / 2.0, y]])
    j.blocks.append(Block(side, pot - 0.04, p.height, (leaves,), None, FINE, billboard=True))


def _lamp(j: Joiner, p: Furniture) -> None:
    j.drum(0.0, 0.0, p.width * 0.8, 0.0, 0.03, coat("plain", DARK, j.rng), lid=DARK)
    j.drum(0.0, 0.0, 0.035, 0.03, p.height - 0.28, coat("plain", DARK, j.rng))
    j.drum(
        0.0,
        0.0,
        p.width,
        p.height - 0.3,
        p.height,
        coat("plain", rgb(p.colour), j.rng),
        lid=rgb("#fff3cf"),
        glow=True,
    )


def _bench(j: Joiner, p: Furniture) -> None:
    j.legs(p.width - 0.1, p.depth - 0.04, p.height - 0.05, 0.06, coat("plain", DARK, j.rng))
    j.slab(p.width, p.depth, p.height - 0.05, p.height, rgb(p.colour))


def _box(j: Joiner, p: Furniture) -> None:
    colour = rgb(p.colour)
    j.box(0.0, 0.0, p.width, p.depth, 0.0, p.height, coat("plain", colour, j.rng), lid=colour)


def _cylinder(j: Joiner, p: Furniture) -> None:
    colour = rgb(p.colour)
    j.drum(0.0, 0.0, p.width, 0.0, p.height, coat("plain", colour, j.rng), lid=colour)


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
    """Return a charging station: its body, and a plate with its marker above it at the height of a
    camera.
    """
    rng = np.random.default_rng(seed)
    pose = station_pose(dock)
    # its front looks at the robot
    joiner = Joiner(Pose2D(pose.x, pose.y, pose.theta - math.pi / 2.0), rng)
    body = dock.station
    dark = coat("plain", rgb("#3a4046"), rng)
    joiner.box(
        0.0,
        0.0,
        body.width,
        body.depth,
        0.0,
        body.height,
        dark,
        front=pictures.station,
        lid=rgb("#6a7178"),
        density=FINE,
    )

    def plate(columns: int, rows: int) -> Picture:
        return pictures.marker(columns, rows, seed)

    white = coat("plain", WHITE, rng)
    joiner.box(
        0.0,
        body.depth / 2.0 - 0.02,
        0.5,
        0.03,
        body.height + 0.1,
        body.height + 0.6,
        white,
        front=plate,
        lid=WHITE,
        density=FINE,
    )
    return joiner.blocks


def leaf_block(door: Door, state: DoorState, rng: np.random.Generator) -> Block:
    """Return a door's leaf, open or closed."""
    end = leaf_end(door, state)
    middle = Pose2D(
        (door.start[0] + end[0]) / 2.0,
        (door.start[1] + end[1]) / 2.0,
        math.atan2(end[1] - door.start[1], end[0] - door.start[0]),
    )
    colour = rgb(door.colour)
    outline = rectangle(middle, math.dist(door.start, end), door.leaf)
    rows = round(door.height * FINE)
    faces = []
    for number, (a, b) in enumerate(zip(outline, np.roll(outline, -1, axis=0), strict=True)):
        columns = max(1, round(math.dist(a, b) * FINE))
        if number % 2 == 0:
            faces.append(
                pictures.door_leaf(columns, rows, colour, FINE, rng, handle_left=number == 2)
            )
        else:
            faces.append(
                np.broadcast_to(colour * np.float32(0.85), (columns, rows, 3)).astype(np.float32)
            )
    return Block(
        np.hstack([outline, np.roll(outline, -1, axis=0)]),
        0.005,
        door.height,
        tuple(faces),
        colour,
        FINE,
    )


def body_blocks(parts: tuple[BodyPart, ...], rng: np.random.Generator) -> list[Block]:
    """Return a robot's body about the origin, its nose along x."""
    # a block's front looks to its -y: to the robot's +x
    joiner = Joiner(Pose2D(0.0, 0.0, math.pi / 2.0), rng)
    for part in parts:
        colour = rgb(part.colour)
        paint = coat("plain", colour, rng)
        if part.shape == "cylinder":
            joiner.drum(part.y, -part.x, part.width, part.bottom, part.top, paint, lid=colour)
        else:
            front = pictures.robot_face if part.face == "screen" else None
            joiner.box(
                part.y,
                -part.x,
                part.depth,
                part.width,
                part.bottom,
                part.top,
                paint,
                front=front,
                lid=colour,
                density=FINE,
            )
    return joiner.blocks
