"""A site made ready for the camera: faces of walls, floor, ceiling and things, with their textures
lit and in one atlas.
"""

import dataclasses
import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from robots.api.floorplan import (
    Decoration,
    Door,
    DoorState,
    FloorPlan,
    Mirror,
    Passage,
    Surface,
    Wall,
)
from robots.api.geometry import Pose2D
from robots.simulator.render import furniture, textures
from robots.simulator.render.furniture import Block
from robots.simulator.render.lighting import Lights, hang, light_floor, light_wall
from robots.simulator.render.materials import (
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
from robots.simulator.render.texture_atlas import Flat, TextureAtlas, Upright
from robots.world.robot_models import RobotModel
from robots.world.sensing import points_from_frame
from robots.world.solids import Floats, bar, fixed_solids, inside, leaf_turn, rectangle, sides

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
    """An upper face: `width` x `height` texels from `offset` on, a single one for a plain colour;
    texel (u, v) = matrix @ (x, y) + shift for a world point in metres.
    """

    offset: int
    width: int = 1
    height: int = 1
    matrix: Floats = field(default_factory=lambda: np.zeros((2, 2)))
    shift: Floats = field(default_factory=lambda: np.zeros(2))


@dataclass(frozen=True, eq=False)
class SceneItem:
    """Faces that the camera draws together: upright faces of one height, and perhaps a lid.

    `sides` (n, 4) in the world, or about the origin for what moves; `offsets` and `columns`
    (levels, n) into the atlas; `group` is shared by the parts of one thing, which must not be
    sorted apart; `under` is the colour of the lower face, -1 when it has none. `billboard`: its one
    side always turns to the viewer; `holes`: its texture is transparent in places; `mirrored`: the
    texture is reversed.
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
        """Return the item, made about the origin, at a pose; a lid's texture is not turned."""
        return dataclasses.replace(self, sides=moved_sides(self.sides, pose))


def moved_sides(sides: Floats, pose: Pose2D) -> Floats:
    """Return sides (n, 4) that were made about the origin at a pose."""
    return points_from_frame(pose, sides.reshape(-1, 2)).reshape(-1, 4)


@dataclass(frozen=True, eq=False)
class Glass:
    """A mirror: its line (4,), glass to the left of start → end, and its lower and upper edge."""

    line: Floats
    bottom: float
    top: float

    @cached_property
    def length(self) -> float:
        return math.dist(self.line[:2], self.line[2:])

    @cached_property
    def along(self) -> Floats:
        """Unit vector (2,) from start to end; `normal` points out of the glass."""
        along: Floats = (self.line[2:] - self.line[:2]) / self.length
        return along

    @cached_property
    def normal(self) -> Floats:
        return np.array([-self.along[1], self.along[0]])


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
        """Return a swinging leaf, lit as in the nearer state of rest."""
        state: DoorState = "open" if opening > 0.5 else "closed"
        leaf = self.leaves[door.name, state]
        turn = leaf_turn(door, opening) - leaf_turn(door, state)
        hinge = Pose2D(*door.start, 0.0)
        return leaf.moved(hinge.inverse()).moved(Pose2D(*door.start, turn))


class Builder:
    """Makes a scene, which takes a second."""

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
        for number, dock in enumerate(self.plan.docks, start=1):
            items += [self._item(dock.name, block) for block in furniture.dock_blocks(dock, number)]
        states: tuple[DoorState, ...] = ("open", "closed")
        leaves = {
            (door.name, state): self._item(door.name, furniture.leaf_block(door, state, self.rng))
            for door in self.plan.doors
            for state in states
        }
        body = tuple(
            self._item("robot", block, lit=False)
            for block in furniture.body_blocks(model.body, self.rng)
        )
        return RenderScene(
            ceiling=self.plan.ceiling,
            texture_atlas=self.texture_atlas,
            walls=walls,
            wall_offsets=_levels([upright.offsets for upright in uprights]),
            wall_columns=_levels([upright.columns for upright in uprights]),
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
        """Return the faces that can be seen from a room or an opening, and their textures."""
        trim = Surface(material="trim", colour="#f1eee6")
        faces: list[Floats] = []
        uprights: list[Upright] = []
        for wall in self.plan.walls:
            surfaces = (wall.right, trim, wall.left, trim)
            for surface, side in zip(surfaces, _bar_sides(wall), strict=True):
                start, end = side[:2], side[2:]
                if self._is_seen(start, end):
                    faces.append(side)
                    picture = self._wall_picture(surface, start, end)
                    uprights.append(self.texture_atlas.upright(picture))
        return np.array(faces), uprights

    def _is_seen(self, start: Floats, end: Floats) -> bool:
        length = math.dist(start, end)
        normal = np.array([end[1] - start[1], start[0] - end[0]]) / length
        for share in np.linspace(0.05, 0.95, 7):
            x, y = start + share * (end - start) + 0.02 * normal
            if self.plan.room_at(float(x), float(y)) is not None:
                return True
            if any(
                inside(bar(each.start, each.end, each.thickness + 0.02), x, y)
                for each in self.plan.openings
            ):
                return True
        return False

    def _wall_picture(self, look: Surface, start: Floats, end: Floats) -> Picture:
        columns = max(1, round(math.dist(start, end) * WALL_DENSITY))
        rows = round(self.plan.ceiling * WALL_DENSITY)
        u, z = metres(columns, rows, WALL_DENSITY)
        picture = WALLS[look.material](u, z, rgb(look.colour), self.rng)
        if look.material != "trim":
            skirt(picture, z, self.plan.ceiling)
        self._casings(picture, start, end)
        for mirror in self.plan.mirrors:
            ends = [_along(start, end, *mirror.start), _along(start, end, *mirror.end)]
            _mirror_frame(picture, mirror, [at for at in ends if at is not None])
        bright = [d for d in self.plan.decorations if d.kind in {"window", "screen"}]
        for decoration in self.plan.decorations:
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
            for corner in _bar(opening):
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
        right, left = (self._surface_beside(opening, right=side) for side in (True, False))
        surfaces, segments = (right, Surface(), left, Surface()), _bar_sides(opening)
        faces, casing = [], round(CASING * WALL_DENSITY)
        for surface, side in zip(surfaces, segments, strict=True):
            columns = max(1, round(math.dist(side[:2], side[2:]) * WALL_DENSITY))
            u, z = metres(columns, max(1, round(above * WALL_DENSITY)), WALL_DENSITY)
            z = opening.height + z
            colour = rgb(surface.colour)
            picture = WALLS[surface.material](u, z.astype(np.float32), colour, self.rng)
            skirt(picture, z, self.plan.ceiling)
            picture[:, :casing] = WHITE * 0.98
            picture[:, casing : casing + 1] *= 0.75
            faces.append(picture)
        block = Block(segments, opening.height, self.plan.ceiling, tuple(faces), None, WALL_DENSITY)
        item = self._item(f"lintel of {opening.name}", block)
        under = self.texture_atlas.colour(WHITE * np.float32(0.72))
        return [dataclasses.replace(item, under=under)]

    def _surface_beside(self, opening: Door | Passage, *, right: bool) -> Surface:
        """Return the surface of the wall that continues beside an opening."""
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
        floor, roof = self._floor(low, high), self._roof(low, high)
        return self.texture_atlas.flat(floor), self.texture_atlas.flat(roof, 1), low

    def _floor(self, low: Floats, high: Floats) -> Picture:
        x, y = _texels(low, high, FLOOR_DENSITY)
        picture = np.empty((y.size, x.size, 3), dtype=np.float32)
        picture[...] = rgb("#8f8a80")
        for room in self.plan.rooms:
            polygon = np.array(room.polygon)
            corners = np.stack([polygon.min(axis=0) - 0.1, polygon.max(axis=0) + 0.1])
            rows, columns = _around(corners, x, y)
            picture[rows, columns] = FLOORS[room.floor](
                x[None, columns], y[rows, None], rgb(room.floor_colour), self.rng
            )
        picture[_covered(map(_bar, self.plan.openings), x, y)] = rgb("#77634a")
        for piece in self.plan.rugs:
            woven = rug(piece.width, piece.depth, rgb(piece.colour), FLOOR_DENSITY, self.rng)
            _lay(picture, x, y, Pose2D(piece.x, piece.y, piece.theta), woven)
        for dock in self.plan.docks:
            lane = Pose2D(dock.x, dock.y, dock.theta).compose(Pose2D(-0.25, 0.0, 0.0))
            _lay(picture, x, y, lane, _guide(dock.station.width))
        solid = _covered((each.outline for each in fixed_solids(self.plan)), x, y)
        light_floor(picture, self.lights, x, y, solid=solid, height=0.0, upwards=True)
        self._sunlight(picture, x, y)
        return picture

    def _roof(self, low: Floats, high: Floats) -> Picture:
        x, y = _texels(low, high, CEILING_DENSITY)
        grain = noise((y.size, x.size), (1, 1), self.rng)
        picture = tint(1.0 + 0.006 * grain, rgb("#f6f4ee"))
        solid = _covered(map(_bar, self.plan.walls), x, y)
        light_floor(
            picture, self.lights, x, y, solid=solid, height=self.plan.ceiling, upwards=False
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

    def _sunlight(self, picture: Picture, x: Plane, y: Plane) -> None:
        """Let daylight fall from every window onto the floor, two metres into the room."""
        for decoration in self.plan.decorations:
            face = self._face_of(decoration) if decoration.kind == "window" else None
            if face is None:
                continue
            start, end = face[:2], face[2:]
            along = (end - start) / math.dist(start, end)
            normal = np.array([along[1], -along[0]])
            place = np.array([[decoration.x, decoration.y]])
            rows, columns = _around(np.vstack([place - SUNLIT, place + SUNLIT]), x, y)
            dx = x[None, columns] - np.float32(decoration.x)
            dy = y[rows, None] - np.float32(decoration.y)
            away, aside = dx * normal[0] + dy * normal[1], dx * along[0] + dy * along[1]
            slanted = aside - 0.35 * away
            wide = np.clip((decoration.width / 2.0 - np.abs(slanted)) / 0.15, 0.0, 1.0)
            patch = wide * np.clip((0.75 - np.abs(away - 1.35)) / 0.25, 0.0, 1.0)
            bars = 1.0 - 0.75 * np.clip(1.0 - np.abs(slanted) / 0.04, 0.0, 1.0)
            light = (0.3 * patch * bars)[..., None].astype(np.float32)
            picture[rows, columns] *= 1.0 + light * np.array([1.0, 0.92, 0.72], dtype=np.float32)

    def _face_of(self, decoration: Decoration) -> Floats | None:
        for wall in self.plan.walls:
            for side in _bar_sides(wall):
                if _along(side[:2], side[2:], decoration.x, decoration.y) is not None:
                    return np.asarray(side)
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
            offsets=_levels([upright.offsets for upright in uprights]),
            columns=_levels([upright.columns for upright in uprights]),
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
        shade: Picture = block.lid
        if lit and not block.glow:
            light = self.lights.at(point, np.array([[0.0, 0.0, 1.0]]), room)[0]
            shade = shade * light.astype(np.float32)
        if shade.ndim == 1:
            return Lid(self.texture_atlas.colour(shade.astype(np.float32)))
        origin, right, up = block.sides[0, :2], block.sides[1, :2], block.sides[3, :2]
        axes = np.stack([(end - origin) / math.dist(end, origin) for end in (right, up)])
        axes *= block.density
        flat = self.texture_atlas.flat(shade, 1)
        return Lid(flat.offsets[0], flat.widths[0], flat.heights[0], axes, -axes @ origin)


def _mirror_frame(picture: Picture, mirror: Mirror, ends: list[float]) -> None:
    """Paint a mirror's frame if both of its ends, metres along the face, are on it."""
    if len(ends) < 2:
        return
    a = round((min(ends) - MIRROR_RIM) * WALL_DENSITY)
    b = round((max(ends) + MIRROR_RIM) * WALL_DENSITY)
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


def _covered(outlines: Iterable[Floats], x: Plane, y: Plane) -> npt.NDArray[np.bool_]:
    """Tell which texels (rows, columns) lie in one of some convex outlines."""
    mask = np.zeros((y.size, x.size), dtype=np.bool_)
    for outline in outlines:
        rows, columns = _around(outline, x, y)
        points = np.meshgrid(x[columns].astype(np.float64), y[rows].astype(np.float64))
        mask[rows, columns] |= inside(outline, *points)
    return mask


def _bar(straight: Wall | Door | Passage) -> Floats:
    return bar(straight.start, straight.end, straight.thickness)


def _bar_sides(straight: Wall | Door | Passage) -> Floats:
    """Return the sides (4, 4): right, far end, left, near end."""
    return sides(_bar(straight))


def _levels(numbers: list[tuple[int, ...]]) -> npt.NDArray[np.intp]:
    """Return (levels, n) of n tuples with a number for each level."""
    return np.array(numbers, dtype=np.intp).T.copy()


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
