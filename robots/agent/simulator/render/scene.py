"""A site made ready for the camera: faces of walls, floor, ceiling and things, all of their
pictures lit and in one atlas.

Longer than most files: every part is a few lines, and all of them fill the one atlas.
"""

import dataclasses
import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from robots.agent.simulator.render import furniture, textures
from robots.agent.simulator.render.furniture import Block
from robots.agent.simulator.render.lighting import Lights, hang, light_floor, light_wall
from robots.agent.simulator.render.materials import (
    FLOORS,
    WALLS,
    WHITE,
    Picture,
    Plane,
    metres,
    noise,
    rgb,
    rug,
    skirt,
    tint,
)
from robots.agent.simulator.render.texture_atlas import Flat, TextureAtlas, Upright
from robots.api.floorplan import Decoration, Door, DoorState, FloorPlan, Mirror, Passage, Surface
from robots.api.geometry import Pose2D
from robots.world.robot_models import RobotModel
from robots.world.solids import Floats, bar, fixed_solids, inside, leaf_turn, rectangle

WALL_DENSITY = 100.0  # texels a metre
FLOOR_DENSITY = 100.0
CEILING_DENSITY = 40.0
CASING = 0.08  # width of the frame around an opening
BESIDE = 0.03
MARGIN = 0.3
LAMP_SIZE, LAMP_RIM = 0.3, 0.34  # half widths, metres
MIRROR_RIM = 0.05
SUNLIT = 3.0  # metres about a window


@dataclass(frozen=True, eq=False)
class Lid:
    """An upper face: `width` x `height` texels from `offset` on, and the way from world metres to
    them: (u, v) = matrix @ (x, y) + shift.

    One texel is one colour.
    """

    offset: int
    width: int = 1
    height: int = 1
    matrix: Floats = field(default_factory=lambda: np.zeros((2, 2)))
    shift: Floats = field(default_factory=lambda: np.zeros(2))


@dataclass(frozen=True, eq=False)
class SceneItem:
    """What the camera draws at once: upright faces of one height, and perhaps a lid.

    `sides` (n, 4) in the world, or about the origin for what moves; `offsets` and `columns`
    (levels, n) into the atlas; `group` is shared by the parts of one thing, which must not be
    sorted apart; `under` is the colour of the lower face, -1 when it has none. `billboard`: its one
    side always turns to who looks; `holes`: one looks through its picture here and there;
    `mirrored`: the picture is the wrong way round.
    """

    group: str
    sides: Floats
    bottom: float
    top: float
    density: float
    offsets: npt.NDArray[np.intp]
    columns: npt.NDArray[np.intp]
    rows: int
    lid: Lid | None
    billboard: bool
    under: int = -1
    holes: bool = False
    mirrored: bool = False

    def moved(self, pose: Pose2D) -> "SceneItem":
        """Return the item, made about the origin, at a pose; a lid's picture is not turned."""
        cosine, sine = math.cos(pose.theta), math.sin(pose.theta)
        matrix = np.array([[cosine, sine], [-sine, cosine]])
        sides = np.hstack([self.sides[:, :2] @ matrix, self.sides[:, 2:] @ matrix]) + np.array(
            [pose.x, pose.y, pose.x, pose.y]
        )
        return dataclasses.replace(self, sides=sides)


@dataclass(frozen=True, eq=False)
class Glass:
    """A mirror: its line (4,), glass to the left of start → end, and its lower and upper edge."""

    line: Floats
    bottom: float
    top: float


@dataclass(frozen=True, eq=False)
class RenderScene:
    """Everything that the camera needs.

    `walls` (n, 4) are faces from floor to ceiling, counter-clockwise about their wall;
    `wall_offsets`, `wall_columns` (levels, n). `corner` is the world point of the floor's and the
    ceiling's first texel.
    """

    ceiling: float
    texture_atlas: TextureAtlas
    walls: Floats
    wall_offsets: npt.NDArray[np.intp]
    wall_columns: npt.NDArray[np.intp]
    wall_rows: int
    wall_lengths: Floats
    floor: Flat
    roof: Flat
    corner: Floats
    items: tuple[SceneItem, ...]
    leaves: dict[tuple[str, DoorState], SceneItem]
    body: tuple[SceneItem, ...]
    mirrors: tuple[Glass, ...]

    def swinging(self, door: Door, opening: float) -> SceneItem:
        """Return a leaf on its way, as it is lit at the nearer end of it."""
        state: DoorState = "open" if opening > 0.5 else "closed"
        leaf = self.leaves[door.name, state]
        turn = leaf_turn(door, opening) - leaf_turn(door, state)
        hinge = Pose2D(*door.start, 0.0)
        return leaf.moved(hinge.inverse()).moved(Pose2D(*door.start, turn))


class Builder:
    """Makes a scene; a second's work, once."""

    def __init__(self, plan: FloorPlan, seed: int) -> None:
        self.plan = plan
        self.rng = np.random.default_rng([seed, 7])
        self.texture_atlas = TextureAtlas()
        self.lights: Lights = hang(plan)

    def build(self, model: RobotModel) -> RenderScene:
        """Return the scene of a plan, and of a robot for its mirrors."""
        walls, uprights = self._walls()
        floor, roof, corner = self._floor_and_roof()
        items = [item for opening in self.plan.openings for item in self._lintel(opening)]
        for piece in self.plan.furniture:
            items += [self._item(piece.name, block) for block in furniture.furnish(piece, self.rng)]
        for number, dock in enumerate(self.plan.docks):
            items += [
                self._item(dock.name, block) for block in furniture.dock_blocks(dock, number + 1)
            ]
        states: tuple[DoorState, ...] = ("open", "closed")
        leaves = {
            (d.name, s): self._item(d.name, furniture.leaf_block(d, s, self.rng))
            for d in self.plan.doors
            for s in states
        }
        body = tuple(
            self._item("robot", block, lit=False)
            for block in furniture.body_blocks(model.body, self.rng)
        )
        return RenderScene(
            ceiling=self.plan.ceiling,
            texture_atlas=self.texture_atlas,
            walls=walls,
            wall_offsets=np.array([u.offsets for u in uprights], dtype=np.intp).T.copy(),
            wall_columns=np.array([u.columns for u in uprights], dtype=np.intp).T.copy(),
            wall_rows=uprights[0].rows,
            wall_lengths=np.hypot(walls[:, 2] - walls[:, 0], walls[:, 3] - walls[:, 1]),
            floor=floor,
            roof=roof,
            corner=corner,
            items=tuple(items),
            leaves=leaves,
            body=body,
            mirrors=tuple(
                Glass(np.array([*m.start, *m.end]), m.bottom, m.top) for m in self.plan.mirrors
            ),
        )

    # --- walls ------------------------------------------------------------------------------------

    def _walls(self) -> tuple[Floats, list[Upright]]:
        """Return the faces that can be seen from a room or an opening, and their pictures."""
        faces: list[Floats] = []
        uprights: list[Upright] = []
        for wall in self.plan.walls:
            outline = bar(wall.start, wall.end, wall.thickness)
            looks = (
                wall.right,
                Surface(material="trim", colour="#f1eee6"),
                wall.left,
                Surface(material="trim", colour="#f1eee6"),
            )
            for look, start, end in zip(looks, outline, np.roll(outline, -1, axis=0), strict=True):
                if self._is_seen(start, end):
                    faces.append(np.hstack([start, end]))
                    uprights.append(
                        self.texture_atlas.upright(self._wall_picture(look, start, end))
                    )
        return np.array(faces), uprights

    def _is_seen(self, start: Floats, end: Floats) -> bool:
        length = math.dist(start, end)
        normal = np.array([end[1] - start[1], start[0] - end[0]]) / length
        for share in np.linspace(0.05, 0.95, 7):
            x, y = start + share * (end - start) + 0.02 * normal
            if self.plan.room_at(float(x), float(y)) is not None:
                return True
            if any(
                inside(bar(o.start, o.end, o.thickness + 0.02), np.array([x]), np.array([y]))[0]
                for o in self.plan.openings
            ):
                return True
        return False

    def _wall_picture(self, look: Surface, start: Floats, end: Floats) -> Picture:
        length = math.dist(start, end)
        columns = max(1, round(length * WALL_DENSITY))
        rows = round(self.plan.ceiling * WALL_DENSITY)
        u, z = metres(columns, rows, WALL_DENSITY)
        picture = WALLS[look.material](u, z, rgb(look.colour), self.rng)
        if look.material != "trim":
            skirt(picture, z, self.plan.ceiling)
        self._casings(picture, start, end)
        pasted = [d for d in self.plan.decorations if _along(start, end, d.x, d.y) is not None]
        glass = [
            m
            for m in self.plan.mirrors
            if _along(start, end, *m.start) is not None and _along(start, end, *m.end) is not None
        ]
        for mirror in glass:
            _mirror_frame(picture, start, end, mirror)
        bright = [d for d in pasted if d.kind in {"window", "screen"}]
        for decoration in pasted:
            if decoration not in bright:
                self._paste(picture, start, end, decoration, shadow=decoration.kind != "clock")
        light_wall(
            picture,
            self.lights,
            start,
            end,
            bottom=0.0,
            top=self.plan.ceiling,
            corners=look.material != "trim",
        )
        for decoration in bright:
            self._paste(picture, start, end, decoration, shadow=False)
        return picture

    def _casings(self, picture: Picture, start: Floats, end: Floats) -> None:
        """Paint the frame of an opening where the face ends at one."""
        length = math.dist(start, end)
        wide = round(CASING * WALL_DENSITY)
        for opening in self.plan.openings:
            high = round((opening.height + CASING) * WALL_DENSITY)
            for corner in bar(opening.start, opening.end, opening.thickness):
                at = _along(start, end, float(corner[0]), float(corner[1]), slack=BESIDE)
                if at is None or length < 4.0 * CASING:
                    continue
                part = picture[:wide] if at < length / 2.0 else picture[-wide:]
                part[:, :high] = WHITE * 0.98
                edge = part[-1:] if at < length / 2.0 else part[:1]
                edge[:, :high] = WHITE * 0.75

    def _paste(
        self, picture: Picture, start: Floats, end: Floats, decoration: Decoration, *, shadow: bool
    ) -> None:
        at = _along(start, end, decoration.x, decoration.y)
        columns = round(decoration.width * WALL_DENSITY)
        rows = round(decoration.height * WALL_DENSITY)
        if at is None or columns < 4 or rows < 4:
            return
        if decoration.kind == "sign":
            drawn = textures.sign(columns, rows, decoration.text)
        else:
            drawn = textures.HANGING[decoration.kind](columns, rows, decoration.variant, self.rng)
        left = round(at * WALL_DENSITY) - columns // 2
        low = round(decoration.z * WALL_DENSITY) - rows // 2
        a, b = max(0, -left), max(0, -low)
        target = picture[left + a : left + columns, low + b : low + rows]
        source = drawn[a : a + target.shape[0], b : b + target.shape[1]]
        if shadow:
            picture[max(0, left + 2) : left + columns + 2, max(0, low - 3) : low] *= 0.82
        solid = ~np.isnan(source[..., 0])
        target[solid] = source[solid]

    def _lintel(self, opening: Door | Passage) -> list[SceneItem]:
        """Return the piece of wall above an opening."""
        above = self.plan.ceiling - opening.height
        if above < 0.02:
            return []
        outline = bar(opening.start, opening.end, opening.thickness)
        looks = (
            self._look_beside(opening, right=True),
            Surface(),
            self._look_beside(opening, right=False),
            Surface(),
        )
        faces = []
        for look, start, end in zip(looks, outline, np.roll(outline, -1, axis=0), strict=True):
            columns = max(1, round(math.dist(start, end) * WALL_DENSITY))
            rows = max(1, round(above * WALL_DENSITY))
            u, z = metres(columns, rows, WALL_DENSITY)
            z = opening.height + z
            picture = WALLS[look.material](u, z.astype(np.float32), rgb(look.colour), self.rng)
            skirt(picture, z, self.plan.ceiling)
            picture[:, : round(CASING * WALL_DENSITY)] = WHITE * 0.98
            picture[:, round(CASING * WALL_DENSITY) : round(CASING * WALL_DENSITY) + 1] *= 0.75
            faces.append(picture)
        sides = np.hstack([outline, np.roll(outline, -1, axis=0)])
        block = Block(sides, opening.height, self.plan.ceiling, tuple(faces), None, WALL_DENSITY)
        item = self._item(f"lintel of {opening.name}", block)
        return [
            dataclasses.replace(item, under=self.texture_atlas.colour(WHITE * np.float32(0.72)))
        ]

    def _look_beside(self, opening: Door | Passage, *, right: bool) -> Surface:
        """Return how the wall looks that goes on beside an opening."""
        for wall in self.plan.walls:
            for mine, theirs in (
                (opening.start, wall.end),
                (opening.end, wall.start),
                (opening.start, wall.start),
                (opening.end, wall.end),
            ):
                if math.dist(mine, theirs) < BESIDE:
                    along = (opening.end[0] - opening.start[0]) * (wall.end[0] - wall.start[0])
                    along += (opening.end[1] - opening.start[1]) * (wall.end[1] - wall.start[1])
                    return wall.right if right == (along > 0.0) else wall.left
        return Surface()

    # --- floor and ceiling ------------------------------------------------------------------------

    def _floor_and_roof(self) -> tuple[Flat, Flat, Floats]:
        points = np.vstack([np.array(room.polygon) for room in self.plan.rooms])
        low, high = points.min(axis=0) - MARGIN, points.max(axis=0) + MARGIN
        floor = self._floor(low, high)
        roof = self._roof(low, high)
        return self.texture_atlas.flat(floor), self.texture_atlas.flat(roof, 1), low

    def _floor(self, low: Floats, high: Floats) -> Picture:
        x, y = _texels(low, high, FLOOR_DENSITY)
        picture = np.empty((y.size, x.size, 3), dtype=np.float32)
        picture[...] = rgb("#8f8a80")
        for room in self.plan.rooms:
            polygon = np.array(room.polygon)
            rows = slice(
                *np.searchsorted(y, [polygon[:, 1].min() - 0.1, polygon[:, 1].max() + 0.1])
            )
            columns = slice(
                *np.searchsorted(x, [polygon[:, 0].min() - 0.1, polygon[:, 0].max() + 0.1])
            )
            picture[rows, columns] = FLOORS[room.floor](
                x[None, columns], y[rows, None], rgb(room.floor_colour), self.rng
            )
        for opening in self.plan.openings:
            outline = bar(opening.start, opening.end, opening.thickness)
            rows, columns = _around(outline, x, y)
            picture[rows, columns][_covers(outline, x[columns], y[rows])] = rgb("#77634a")
        for piece in self.plan.rugs:
            woven = rug(piece.width, piece.depth, rgb(piece.colour), FLOOR_DENSITY, self.rng)
            _lay(picture, x, y, Pose2D(piece.x, piece.y, piece.theta), woven)
        for dock in self.plan.docks:
            _lay(
                picture,
                x,
                y,
                Pose2D(dock.x, dock.y, dock.theta).compose(Pose2D(-0.25, 0.0, 0.0)),
                _guide(dock.station.width),
            )
        light_floor(
            picture, self.lights, x, y, solid=self._standing(x, y), height=0.0, upwards=True
        )
        self._sunlight(picture, x, y)
        return picture

    def _roof(self, low: Floats, high: Floats) -> Picture:
        x, y = _texels(low, high, CEILING_DENSITY)
        grain = noise((y.size, x.size), (1, 1), self.rng)
        picture = tint(1.0 + 0.006 * grain, rgb("#f6f4ee"))
        walls = np.zeros((y.size, x.size), dtype=np.bool_)
        for wall in self.plan.walls:
            outline = bar(wall.start, wall.end, wall.thickness)
            rows, columns = _around(outline, x, y)
            walls[rows, columns] |= _covers(outline, x[columns], y[rows])
        light_floor(
            picture, self.lights, x, y, solid=walls, height=self.plan.ceiling, upwards=False
        )
        for lamps in self.lights.lamps.values():
            for lamp in lamps:
                dx, dy = np.abs(x[None, :] - lamp[0]), np.abs(y[:, None] - lamp[1])
                glow = np.exp(
                    -(np.maximum(dx - LAMP_SIZE, 0.0) ** 2 + np.maximum(dy - LAMP_SIZE, 0.0) ** 2)
                    / 0.12
                )
                picture += 0.35 * glow[..., None].astype(np.float32) * rgb("#fff1d6")
                picture[(dx < LAMP_RIM) & (dy < LAMP_RIM)] = rgb("#d9d5cb")
                picture[(dx < LAMP_SIZE) & (dy < LAMP_SIZE)] = rgb("#fffdf4")
        return picture

    def _standing(self, x: Plane, y: Plane) -> npt.NDArray[np.bool_]:
        mask = np.zeros((y.size, x.size), dtype=np.bool_)
        for solid in fixed_solids(self.plan):
            rows, columns = _around(solid.outline, x, y)
            mask[rows, columns] |= _covers(solid.outline, x[columns], y[rows])
        return mask

    def _sunlight(self, picture: Picture, x: Plane, y: Plane) -> None:
        """Let daylight fall from every window onto the floor, two metres into the room."""
        for decoration in self.plan.decorations:
            face = self._face_of(decoration) if decoration.kind == "window" else None
            if face is None:
                continue
            start, end = face
            along = (end - start) / math.dist(start, end)
            normal = np.array([along[1], -along[0]])
            place = np.array([[decoration.x, decoration.y]])
            rows, columns = _around(np.vstack([place - SUNLIT, place + SUNLIT]), x, y)
            dx = x[None, columns] - np.float32(decoration.x)
            dy = y[rows, None] - np.float32(decoration.y)
            away, aside = dx * normal[0] + dy * normal[1], dx * along[0] + dy * along[1]
            slanted = aside - 0.35 * away
            patch = np.clip((decoration.width / 2.0 - np.abs(slanted)) / 0.15, 0.0, 1.0) * np.clip(
                (0.75 - np.abs(away - 1.35)) / 0.25, 0.0, 1.0
            )
            bars = 1.0 - 0.75 * np.clip(1.0 - np.abs(slanted) / 0.04, 0.0, 1.0)
            picture[rows, columns] *= 1.0 + (0.3 * patch * bars)[..., None].astype(
                np.float32
            ) * np.array([1.0, 0.92, 0.72], dtype=np.float32)

    def _face_of(self, decoration: Decoration) -> tuple[Floats, Floats] | None:
        for wall in self.plan.walls:
            outline = bar(wall.start, wall.end, wall.thickness)
            for start, end in zip(outline, np.roll(outline, -1, axis=0), strict=True):
                if _along(start, end, decoration.x, decoration.y) is not None:
                    return start, end
        return None

    # --- things -----------------------------------------------------------------------------------

    def _item(self, group: str, block: Block, *, lit: bool = True) -> SceneItem:
        uprights = []
        for picture, side in zip(block.pictures, block.sides, strict=True):
            if lit and not block.glow:
                light_wall(
                    picture,
                    self.lights,
                    side[:2],
                    side[2:],
                    bottom=block.bottom,
                    top=block.top,
                    corners=False,
                )
            uprights.append(self.texture_atlas.upright(picture))
        return SceneItem(
            group=group,
            sides=block.sides,
            bottom=block.bottom,
            top=block.top,
            density=block.density,
            offsets=np.array([u.offsets for u in uprights], dtype=np.intp).T.copy(),
            columns=np.array([u.columns for u in uprights], dtype=np.intp).T.copy(),
            rows=uprights[0].rows,
            lid=self._lid(block, lit=lit),
            billboard=block.billboard,
            holes=block.billboard,
        )

    def _lid(self, block: Block, *, lit: bool) -> Lid | None:
        if block.lid is None:
            return None
        middle = block.sides[:, :2].mean(axis=0)
        point = np.array([[*middle, block.top]])
        room = self.lights.room_of(float(middle[0]), float(middle[1]))
        light = (
            self.lights.at(point, np.array([[0.0, 0.0, 1.0]]), room)[0].astype(np.float32)
            if lit and not block.glow
            else np.float32(1.0)
        )
        shade: Picture = block.lid * light
        if shade.ndim == 1:
            return Lid(self.texture_atlas.colour(shade.astype(np.float32)))
        origin, right, up = block.sides[0, :2], block.sides[1, :2], block.sides[3, :2]
        axes = (
            np.stack(
                [(right - origin) / math.dist(right, origin), (up - origin) / math.dist(up, origin)]
            )
            * block.density
        )
        flat = self.texture_atlas.flat(shade, 1)
        return Lid(flat.offsets[0], flat.widths[0], flat.heights[0], axes, -axes @ origin)


def _mirror_frame(picture: Picture, start: Floats, end: Floats, mirror: Mirror) -> None:
    ends = sorted(
        at
        for at in (_along(start, end, *mirror.start), _along(start, end, *mirror.end))
        if at is not None
    )
    a = round((ends[0] - MIRROR_RIM) * WALL_DENSITY)
    b = round((ends[1] + MIRROR_RIM) * WALL_DENSITY)
    low = round((mirror.bottom - MIRROR_RIM) * WALL_DENSITY)
    high = round((mirror.top + MIRROR_RIM) * WALL_DENSITY)
    picture[max(0, a) : b, max(0, low) : high] = rgb("#8a6a3c")
    picture[max(0, a) : b, high - 2 : high] = rgb("#c9a565")


def _along(start: Floats, end: Floats, x: float, y: float, slack: float = BESIDE) -> float | None:
    """Return how far along a face a point on it lies, in metres, or None when it does not."""
    length = math.dist(start, end)
    ux, uy = (end[0] - start[0]) / length, (end[1] - start[1]) / length
    at, off = (x - start[0]) * ux + (y - start[1]) * uy, (x - start[0]) * uy - (y - start[1]) * ux
    return float(at) if -slack <= at <= length + slack and abs(off) <= slack else None


def _texels(low: Floats, high: Floats, density: float) -> tuple[Plane, Plane]:
    columns, rows = np.ceil((high - low) * density).astype(int).tolist()
    x = (low[0] + (np.arange(columns) + 0.5) / density).astype(np.float32)
    y = (low[1] + (np.arange(rows) + 0.5) / density).astype(np.float32)
    return x, y


def _around(points: Floats, x: Plane, y: Plane) -> tuple[slice, slice]:
    """Return the rows and columns of texels about points (n, 2)."""
    low, high = points.min(axis=0), points.max(axis=0)
    return slice(*np.searchsorted(y, [low[1], high[1]]).tolist()), slice(
        *np.searchsorted(x, [low[0], high[0]]).tolist()
    )


def _covers(outline: Floats, x: Plane, y: Plane) -> npt.NDArray[np.bool_]:
    """Tell which texels (rows, columns) lie in a convex outline."""
    return inside(outline, *np.meshgrid(x.astype(np.float64), y.astype(np.float64)))


def _lay(picture: Picture, x: Plane, y: Plane, pose: Pose2D, flat: Picture) -> None:
    """Lay a picture (rows, columns, 3) on the floor, middle at `pose`; NaN is transparent."""
    depth, width = flat.shape[:2]
    cosine, sine = math.cos(pose.theta), math.sin(pose.theta)
    rows, columns = _around(rectangle(pose, width / FLOOR_DENSITY, depth / FLOOR_DENSITY), x, y)
    dx, dy = x[None, columns] - pose.x, y[rows, None] - pose.y
    u = np.floor((dx * cosine + dy * sine) * FLOOR_DENSITY + width / 2.0).astype(np.intp)
    v = np.floor((dy * cosine - dx * sine) * FLOOR_DENSITY + depth / 2.0).astype(np.intp)
    on = (u >= 0) & (u < width) & (v >= 0) & (v < depth)
    colours = flat[v[on], u[on]]
    on[on] = ~np.isnan(colours[:, 0])
    picture[rows, columns][on] = colours[~np.isnan(colours[:, 0])]


def _guide(width: float) -> Picture:
    """Return the lane before a station, x along columns: two lines, arrows between them."""
    rows, columns = round((width + 0.2) * FLOOR_DENSITY), round(1.5 * FLOOR_DENSITY)
    picture = np.full((rows, columns, 3), np.nan, dtype=np.float32)
    v, u = np.mgrid[0:rows, 0:columns] / FLOOR_DENSITY
    aside = np.abs(v - rows / FLOOR_DENSITY / 2.0)
    yellow = rgb("#f2c230")
    picture[np.abs(aside - width / 2.0 - 0.04) < 0.025] = yellow
    picture[(np.mod(u + aside, 0.34) < 0.07) & (aside < 0.12) & (u < 1.0)] = yellow
    return picture
