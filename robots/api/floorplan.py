"""A site as data: plan.json, in the folder of the map_server image of the same place.

The simulator builds its walls, rooms and pictures from it; the server and the page's map take
names, doors, docks, checkpoints and places. Metres and radians in the frame of the map. On the wire
it is camelCase JSON, like every other message.

Titles are in one language, English in our own sites; `translations` has them in others, and
`in_language` applies these. Robots use names, and do not get translations.

Two layers of checks: msgspec refuses a malformed plan, `problems()` lists why a well-formed one
cannot be a place.
"""

import math
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta, Struct

from robots.api.messages import Metres, Name, Point, Radians

Length = Annotated[float, Meta(gt=0.0, le=1000.0)]
Height = Annotated[float, Meta(ge=0.0, le=20.0)]
Colour = Annotated[str, Meta(pattern=r"^#[0-9a-fA-F]{6}$")]
Key = Annotated[str, Meta(pattern=r"^[a-z0-9][a-z0-9_-]{0,63}$")]
Language = Annotated[str, Meta(pattern=r"^[a-z]{2,3}(-[a-z0-9]{2,8})*$", max_length=16)]
DoorState = Literal["open", "closed"]

WallMaterial = Literal["plaster", "brick", "wallpaper", "panelling", "two_tone", "concrete", "trim"]
FloorMaterial = Literal["oak", "tiles", "carpet", "concrete"]
FurnitureKind = Literal[
    "desk",
    "chair",
    "sofa",
    "armchair",
    "table",
    "bookcase",
    "cabinet",
    "plant",
    "lamp",
    "bench",
    "television",
    "box",
    "cylinder",
]
DecorationKind = Literal["picture", "window", "whiteboard", "poster", "clock", "sign", "screen"]

MINIMUM_DOOR = 0.5
MINIMUM_LENGTH = 0.02
MINIMUM_ROOM = 0.1  # m²
ON_WALL = 0.02  # m; maximum distance of a decoration or mirror from the face of its wall


class FloorPlanError(ValueError):
    """A plan that cannot be used; `problems` has one sentence for each error and its place."""

    def __init__(self, problems: tuple[str, ...]) -> None:
        super().__init__("; ".join(problems))
        self.problems = problems


class PlanPart(
    Struct,
    frozen=True,
    kw_only=True,
    rename="camel",
    omit_defaults=True,
    forbid_unknown_fields=True,
):
    """Base of everything in a plan. Unknown fields are refused: in a file written by hand they are
    typing errors.
    """


class Room(PlanPart, frozen=True, kw_only=True):
    """A room; `polygon` is its floor, in order, not closed."""

    name: Key
    title: Name
    polygon: Annotated[tuple[Point, ...], Meta(min_length=3, max_length=200)]
    floor: FloorMaterial = "oak"
    floor_colour: Colour = "#b08d62"


class Surface(PlanPart, frozen=True, kw_only=True):
    """The appearance of one side of a wall."""

    material: WallMaterial = "plaster"
    colour: Colour = "#efe9dd"


class Wall(PlanPart, frozen=True, kw_only=True):
    """A straight wall from floor to ceiling: centre line, thickness, and its two sides as seen when
    walking from start to end.
    """

    start: Point
    end: Point
    thickness: Length = 0.15
    left: Surface = Surface()
    right: Surface = Surface()


class Passage(PlanPart, frozen=True, kw_only=True):
    """An opening without a door between two rooms; above `height` the wall goes on."""

    name: Key
    title: Name
    start: Point
    end: Point
    thickness: Length = 0.15
    height: Height = 2.1
    connects: tuple[Key, Key]


class Door(PlanPart, frozen=True, kw_only=True):
    """A door: the closed leaf runs from the hinge at `start` to `end`; open, it is turned by
    `swing` about the hinge.
    """

    name: Key
    title: Name
    start: Point
    end: Point
    swing: Radians
    thickness: Length = 0.15
    leaf: Length = 0.04
    height: Height = 2.1
    state: DoorState = "open"
    colour: Colour = "#8a5a34"
    connects: tuple[Key, Key]


class Decoration(PlanPart, frozen=True, kw_only=True):
    """Something flat on a wall's face: `x`, `y` its centre on that face, `z` the height of its
    centre, in metres.
    """

    kind: DecorationKind
    x: Metres
    y: Metres
    z: Height = 1.5
    width: Length
    height: Length
    variant: Annotated[int, Meta(ge=0, le=1000)] = 0
    text: Name = ""


class Mirror(PlanPart, frozen=True, kw_only=True):
    """A mirror; its glass looks to the left of start → end."""

    name: Key
    title: Name
    start: Point
    end: Point
    bottom: Height = 0.2
    top: Height = 1.9


class Furniture(PlanPart, frozen=True, kw_only=True):
    """A piece of furniture on the floor.

    A box is `width` along its own x and `depth` along its y, its front looks to -y; a cylinder is
    `width` across.
    """

    name: Key
    kind: FurnitureKind
    shape: Literal["box", "cylinder"] = "box"
    x: Metres
    y: Metres
    theta: Radians = 0.0
    width: Length
    depth: Length = 0.5
    height: Height
    colour: Colour = "#8b6b4a"


class Rug(PlanPart, frozen=True, kw_only=True):
    """Something flat on the floor that is no obstacle: `width` along its own x, `depth` along its
    y.
    """

    x: Metres
    y: Metres
    theta: Radians = 0.0
    width: Length
    depth: Length
    colour: Colour = "#8c4a3c"


class Station(PlanPart, frozen=True, kw_only=True):
    """The body of a charging station: its front is `distance` ahead of the docked
    robot's centre.
    """

    distance: Length
    width: Length = 0.5
    depth: Length = 0.12
    height: Height = 0.45


class ChargingDock(PlanPart, frozen=True, kw_only=True):
    """A charging station for one series of robots; `x`, `y`, `theta` is the pose of the docked
    robot, nose to the station.
    """

    name: Key
    title: Name
    type: Key
    x: Metres
    y: Metres
    theta: Radians
    station: Station


class Place(PlanPart, frozen=True, kw_only=True):
    """A named place to drive to."""

    x: Metres
    y: Metres
    theta: Radians = 0.0
    name: Key
    title: Name


class Checkpoint(PlanPart, frozen=True, kw_only=True):
    """One step of the exploration task; reached within `radius`."""

    number: Annotated[int, Meta(ge=0, le=99)]
    x: Metres
    y: Metres
    radius: Length = 0.6
    title: Name = ""


class Route(PlanPart, frozen=True, kw_only=True):
    """The checkpoints for one series of robots, 0 (its dock) first, and the path that is suggested
    between them.
    """

    type: Key
    checkpoints: Annotated[tuple[Checkpoint, ...], Meta(min_length=2, max_length=100)]
    path: Annotated[tuple[Point, ...], Meta(max_length=500)] = ()


class FloorPlan(PlanPart, frozen=True, kw_only=True):
    """A whole site. `ceiling` is its height in metres, `map_id` the name of its map; `translations`
    has translated titles by language and title.
    """

    version: Literal[1] = 1
    map_id: Key
    title: Name
    ceiling: Length = 2.6
    rooms: Annotated[tuple[Room, ...], Meta(min_length=1, max_length=100)]
    walls: Annotated[tuple[Wall, ...], Meta(min_length=3, max_length=2000)]
    doors: Annotated[tuple[Door, ...], Meta(max_length=100)] = ()
    passages: Annotated[tuple[Passage, ...], Meta(max_length=100)] = ()
    decorations: Annotated[tuple[Decoration, ...], Meta(max_length=500)] = ()
    mirrors: Annotated[tuple[Mirror, ...], Meta(max_length=10)] = ()
    furniture: Annotated[tuple[Furniture, ...], Meta(max_length=500)] = ()
    rugs: Annotated[tuple[Rug, ...], Meta(max_length=100)] = ()
    docks: Annotated[tuple[ChargingDock, ...], Meta(max_length=50)] = ()
    places: Annotated[tuple[Place, ...], Meta(max_length=200)] = ()
    starts: Annotated[tuple[Place, ...], Meta(max_length=200)] = ()
    routes: Annotated[tuple[Route, ...], Meta(max_length=50)] = ()
    translations: Annotated[
        dict[Language, Annotated[dict[Name, Name], Meta(max_length=1000)]], Meta(max_length=50)
    ] = {}

    def __hash__(self) -> int:
        """Hash without `translations`, a dictionary: plans are keys of caches."""
        return hash((self.map_id, self.walls, self.doors, self.furniture))

    @property
    def openings(self) -> tuple[Door | Passage, ...]:
        """All doors and passages."""
        return (*self.doors, *self.passages)

    def room_at(self, x: float, y: float) -> Room | None:
        """Return the room whose floor holds the point, or None."""
        return next((room for room in self.rooms if contains(room.polygon, x, y)), None)

    def dock_of(self, series: str) -> ChargingDock | None:
        return next((dock for dock in self.docks if dock.type == series), None)

    def route_of(self, series: str) -> Route | None:
        """Return the task's checkpoints for a series of robots, or None."""
        return next((route for route in self.routes if route.type == series), None)


_decoder = msgspec.json.Decoder(FloorPlan)


def decode(data: bytes | str) -> FloorPlan:
    """Return a checked plan.

    Raises:
        FloorPlanError: malformed JSON, a wrong type or range (with its path in the file), or a plan
            that cannot be a place.
    """
    try:
        plan = _decoder.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise FloorPlanError((str(error),)) from error
    found = problems(plan)
    if found:
        raise FloorPlanError(found)
    return plan


def encode(plan: FloorPlan) -> bytes:
    return msgspec.json.encode(plan)


def in_language(plan: Mapping[str, Any], language: str) -> dict[str, Any]:
    """Return a plan, as JSON, with its titles in a language where there are translations, and
    without the translations.
    """
    words = translation(plan.get("translations", {}), language)
    own = {name: value for name, value in plan.items() if name != "translations"}
    translated: dict[str, Any] = _translated(own, words)
    return translated


def translation(offered: Mapping[str, Mapping[str, str]], language: str) -> Mapping[str, str]:
    """Return the translations to a language, such as `es-mx`, or else to `es`."""
    language = language.lower()
    return offered.get(language) or offered.get(language.partition("-")[0]) or {}


def _translated(value: Any, words: Mapping[str, str]) -> Any:
    if not words:
        return value
    if isinstance(value, list):
        return [_translated(one, words) for one in value]
    if isinstance(value, dict):
        return {
            name: words.get(one, one)
            if name == "title" and isinstance(one, str)
            else _translated(one, words)
            for name, one in value.items()
        }
    return value


def contains(polygon: tuple[Point, ...], x: float, y: float) -> bool:
    """Tell whether a point lies in a simple polygon (even-odd rule)."""
    inside = False
    for (ax, ay), (bx, by) in zip(polygon, (*polygon[1:], polygon[0]), strict=True):
        if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * (bx - ax):
            inside = not inside
    return inside


def problems(plan: FloorPlan) -> tuple[str, ...]:
    """Return a sentence for each error of a well-formed plan; empty when there is none."""
    return (
        *_double_names(plan),
        *_flat(plan),
        *_too_high_or_narrow(plan),
        *_unknown_rooms(plan),
        *_outside(plan),
        *_bad_routes(plan),
        *_stray_translations(plan),
    )


def _double_names(plan: FloorPlan) -> Iterator[str]:
    groups = {
        "room": [r.name for r in plan.rooms],
        "door or passage": [o.name for o in plan.openings],
        "dock": [d.name for d in plan.docks],
        "place": [p.name for p in plan.places],
        "start": [s.name for s in plan.starts],
        "furniture": [f.name for f in plan.furniture],
        "mirror": [m.name for m in plan.mirrors],
        "route": [r.type for r in plan.routes],
    }
    for kind, names in groups.items():
        for name in sorted({n for n in names if names.count(n) > 1}):
            yield f"two things of kind {kind} are called {name!r}"


def _flat(plan: FloorPlan) -> Iterator[str]:
    for room in plan.rooms:
        if abs(_area(room.polygon)) < MINIMUM_ROOM:
            yield f"room {room.name!r} has no area"
    for number, wall in enumerate(plan.walls):
        if math.dist(wall.start, wall.end) < MINIMUM_LENGTH:
            yield f"wall {number} has no length"


def _too_high_or_narrow(plan: FloorPlan) -> Iterator[str]:
    for opening in plan.openings:
        if math.dist(opening.start, opening.end) < MINIMUM_DOOR:
            yield f"{opening.name!r} is narrower than {MINIMUM_DOOR} m"
        if not 0.0 < opening.height <= plan.ceiling:
            yield f"{opening.name!r} is {opening.height} m high, the ceiling is at {plan.ceiling} m"
    for mirror in plan.mirrors:
        if (
            math.dist(mirror.start, mirror.end) < MINIMUM_LENGTH
            or not mirror.bottom < mirror.top <= plan.ceiling
        ):
            yield f"mirror {mirror.name!r} has no surface below the ceiling"
    for piece in plan.furniture:
        if not 0.0 < piece.height <= plan.ceiling:
            yield (
                f"furniture {piece.name!r} is {piece.height} m high, the ceiling is at"
                f" {plan.ceiling} m"
            )


def _unknown_rooms(plan: FloorPlan) -> Iterator[str]:
    known = {room.name for room in plan.rooms}
    for opening in plan.openings:
        for name in opening.connects:
            if name not in known:
                yield f"{opening.name!r} connects the unknown room {name!r}"
        if opening.connects[0] == opening.connects[1]:
            yield f"{opening.name!r} connects a room with itself"


def _outside(plan: FloorPlan) -> Iterator[str]:
    kinds: dict[str, tuple[ChargingDock | Furniture | Place, ...]] = {
        "dock": plan.docks,
        "furniture": plan.furniture,
        "place": plan.places,
        "start": plan.starts,
    }
    points = [(f"{kind} {p.name!r}", p.x, p.y) for kind, parts in kinds.items() for p in parts]
    for route in plan.routes:
        points += [
            (f"checkpoint {c.number} of {route.type!r}", c.x, c.y) for c in route.checkpoints
        ]
    for what, x, y in points:
        if plan.room_at(x, y) is None:
            yield f"{what} at ({x:g}, {y:g}) is not in a room"
    for decoration in plan.decorations:
        if not any(_on_face(wall, decoration.x, decoration.y) for wall in plan.walls):
            where = f"({decoration.x:g}, {decoration.y:g})"
            yield f"{decoration.kind} at {where} does not hang on a wall"


def _bad_routes(plan: FloorPlan) -> Iterator[str]:
    for route in plan.routes:
        numbers = [c.number for c in route.checkpoints]
        if numbers != list(range(len(numbers))):
            yield f"the checkpoints of {route.type!r} are numbered {numbers}, not 0, 1, 2 …"
        if plan.dock_of(route.type) is None:
            yield f"there is a route but no dock for {route.type!r}"


def _stray_translations(plan: FloorPlan) -> Iterator[str]:
    titled: list[Any] = [
        *plan.rooms,
        *plan.openings,
        *plan.mirrors,
        *plan.docks,
        *plan.places,
        *plan.starts,
    ]
    titled += [checkpoint for route in plan.routes for checkpoint in route.checkpoints]
    titles = {plan.title, *(part.title for part in titled)}
    for language, words in plan.translations.items():
        for title in words:
            if title not in titles:
                yield f"the translation to {language!r} of {title!r} belongs to no title"


def _on_face(wall: Wall, x: float, y: float) -> bool:
    length = math.dist(wall.start, wall.end)
    if length < MINIMUM_LENGTH:
        return False
    along = ((wall.end[0] - wall.start[0]) / length, (wall.end[1] - wall.start[1]) / length)
    dx, dy = x - wall.start[0], y - wall.start[1]
    position, offset = dx * along[0] + dy * along[1], abs(dx * along[1] - dy * along[0])
    return (
        -ON_WALL <= position <= length + ON_WALL and abs(offset - wall.thickness / 2.0) <= ON_WALL
    )


def _area(polygon: tuple[Point, ...]) -> float:
    pairs = zip(polygon, (*polygon[1:], polygon[0]), strict=True)
    return 0.5 * sum(ax * by - bx * ay for (ax, ay), (bx, by) in pairs)
