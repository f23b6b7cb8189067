"""A whole plan proposed from a map: what a person then names, moves and completes."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from msgspec import structs

from robots.api.floorplan import FloorPlan, Furniture, Passage, Place, Room, Wall, contains
from robots.api.geometry import wrap_angle
from robots.world.grid import OccupancyGrid
from robots.world.inspection import Floor, drawn_plan
from robots.world.tracing.docks import propose_docks
from robots.world.tracing.layers import Labels, Layers
from robots.world.tracing.obstacles import Obstacle, cells_of_walls, find_obstacles
from robots.world.tracing.openings import Opening, find_openings
from robots.world.tracing.rooms import label_rooms, polygon, with_things
from robots.world.tracing.structure import STRUCTURE, Structure, TracingError, structure_of
from robots.world.tracing.walls import Segment, main_direction, trace_walls

MOST_WALLS, LEAST_WALLS = 2000, 3  # of a plan
MOST_OPENINGS = 100
OBSTACLE_HEIGHT = 1.0  # metres; a map of one height does not tell


@dataclass(frozen=True)
class Titles:
    """The parts' first names, in the language of the person who will name them."""

    room: str = "Room"
    corridor: str = "Corridor"
    opening: str = "Opening"
    station: str = "Charging station"


@dataclass(frozen=True)
class CorridorParams:
    """The proportions of a corridor."""

    widest: float = 3.0  # metres
    length: float = 4.0  # times as long as wide


CORRIDOR = CorridorParams()


@dataclass(frozen=True, eq=False)
class Tracing:
    """The parts found on a map, in its frame; `labels` (h, w) are the numbers of the rooms."""

    structure: Structure
    labels: Labels
    walls: list[Segment]
    openings: list[Opening]
    obstacles: list[Obstacle]

    @classmethod
    def of(cls, grid: OccupancyGrid) -> "Tracing":
        """Trace a map.

        Raises:
            TracingError: it shows no floor, or hardly any walls.
        """
        layers = Layers.of(grid)
        structure = structure_of(layers)
        walls = trace_walls(structure.building, layers)[:MOST_WALLS]
        if len(walls) < LEAST_WALLS:
            share = float(layers.occupied.mean())
            raise TracingError(
                f"the map shows {len(walls)} walls, a plan needs {LEAST_WALLS}: {share:.1%} of its"
                " cells are occupied. If its walls are grey, choose a lower threshold for"
                " occupied cells"
            )
        labels = label_rooms(structure)
        openings = find_openings(structure, labels, main_direction(walls))[:MOST_OPENINGS]
        solid = layers.occupied & ~cells_of_walls(layers, walls)
        labels = with_things(labels, solid, layers)
        obstacles = find_obstacles(structure, solid & (labels > 0))
        return cls(structure, labels, walls, openings, obstacles)


def propose_plan(
    grid: OccupancyGrid, map_id: str, title: str, titles: Titles | None = None
) -> FloorPlan:
    """Return a plan for a map: rooms, walls, openings, obstacles, a place in each room, and a
    charging station for each series of robots where one fits.

    Raises:
        TracingError: the map shows no floor, or hardly any walls.
    """
    titles = titles or Titles()
    tracing = Tracing.of(grid)
    layers = tracing.structure.layers
    rooms = _rooms(tracing, titles)
    shell = FloorPlan(
        map_id=map_id,
        title=title,
        rooms=rooms,
        walls=tuple(_wall(wall, layers) for wall in tracing.walls),
        passages=tuple(_passages(tracing, titles)),
        places=tuple(_places(tracing, rooms)),
    )
    furniture = (
        _furniture(obstacle, number, layers)
        for number, obstacle in enumerate(tracing.obstacles, start=1)
    )
    whole = structs.replace(
        shell,
        furniture=tuple(piece for piece in furniture if shell.room_at(piece.x, piece.y)),
        docks=propose_docks(tracing.structure, tracing.walls, titles.station),
    )
    return _without_unreachable(whole, grid)


def _without_unreachable(plan: FloorPlan, grid: OccupancyGrid) -> FloorPlan:
    """Leave out places and openings that a robot cannot get to, on the map or in the plan: straight
    walls are a little narrower here and there.
    """
    floors = (Floor.of(grid), Floor.of(drawn_plan(plan)))
    return structs.replace(
        plan,
        places=tuple(p for p in plan.places if all(floor.is_reached(p.x, p.y) for floor in floors)),
        passages=tuple(p for p in plan.passages if all(floor.is_open(p) for floor in floors)),
    )


# --- the parts in the plan's words ----------------------------------------------------------------


def _rooms(tracing: Tracing, titles: Titles) -> tuple[Room, ...]:
    layers, labels = tracing.structure.layers, tracing.labels
    clearance = tracing.structure.ground_clearance
    rooms: list[Room] = []
    counts = {titles.room: 0, titles.corridor: 0}
    for number in range(1, int(labels.max()) + 1):
        mine = labels == number
        width = 2.0 * float(clearance[mine].max())
        area = float(mine.sum()) * layers.area
        is_corridor = width <= CORRIDOR.widest and area >= CORRIDOR.length * width**2
        word = titles.corridor if is_corridor else titles.room
        counts[word] += 1
        corners = [layers.to_world((x, y)) for x, y in polygon(labels, number, layers).tolist()]
        rooms.append(
            Room(name=f"room-{number}", title=f"{word} {counts[word]}", polygon=tuple(corners))
        )
    return tuple(rooms)


def _wall(wall: Segment, layers: Layers) -> Wall:
    return Wall(
        start=layers.to_world(wall.start),
        end=layers.to_world(wall.end),
        thickness=round(max(wall.thickness, 0.04), 3),
    )


def _passages(tracing: Tracing, titles: Titles) -> Iterator[Passage]:
    layers = tracing.structure.layers
    for number, opening in enumerate(tracing.openings, start=1):
        yield Passage(
            name=f"opening-{number}",
            title=f"{titles.opening} {number}",
            start=layers.to_world(opening.start),
            end=layers.to_world(opening.end),
            connects=(f"room-{opening.rooms[0]}", f"room-{opening.rooms[1]}"),
        )


def _furniture(obstacle: Obstacle, number: int, layers: Layers) -> Furniture:
    x, y = layers.to_world((obstacle.x, obstacle.y))
    return Furniture(
        name=f"obstacle-{number}",
        kind="cylinder" if obstacle.is_round else "box",
        shape="cylinder" if obstacle.is_round else "box",
        x=x,
        y=y,
        theta=round(wrap_angle(obstacle.direction + layers.world_from_map.theta), 4),
        width=round(obstacle.width, 3),
        depth=round(obstacle.depth, 3),
        height=OBSTACLE_HEIGHT,
    )


def _places(tracing: Tracing, rooms: tuple[Room, ...]) -> Iterator[Place]:
    """Return a place in each room: where there is most space."""
    layers = tracing.structure.layers
    clearance = tracing.structure.floor_clearance
    for number, room in enumerate(rooms, start=1):
        heights = np.where(tracing.labels == number, clearance, -1.0)
        rows, columns = np.unravel_index([int(np.argmax(heights))], heights.shape)
        x, y = layers.to_world(tuple(layers.centres(rows, columns)[0].tolist()))
        if heights.max() >= STRUCTURE.narrowest and contains(room.polygon, x, y):
            yield Place(name=f"place-{number}", title=room.title, x=x, y=y)
