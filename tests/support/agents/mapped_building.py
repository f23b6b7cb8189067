"""A building, and the map that a robot makes of it: turned, with gaps and speckles, unknown beyond
its walls, and with what a laser saw through a window.
"""

import math
from dataclasses import replace

import numpy as np

from robots.api.floorplan import FloorPlan, Furniture, Passage, Point, Room, Wall
from robots.api.geometry import Pose2D
from robots.world.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from robots.world.render_plan import rasterise

THICK = 0.15
GAPS = 0.08  # share of the occupied cells that the robot missed
SPECKLES = 0.0005  # share of the free cells that it took for occupied


def building(door: float = 1.0, *, furnished: bool = False, turned: float = 0.0) -> FloorPlan:
    """Return a corridor of 9 m by 2 m with two rooms of 4.4 m by 4 m above it, and a doorway of
    `door` metres to each; the whole turned by `turned` radians about (0, 0).
    """
    turn = Pose2D(0.0, 0.0, turned)

    def wall(*ends: float) -> Wall:
        return Wall(start=turn.apply(*ends[:2]), end=turn.apply(*ends[2:]), thickness=THICK)

    def room(name: str, left: float, bottom: float, right: float, top: float) -> Room:
        corners = ((left, bottom), (right, bottom), (right, top), (left, top))
        return Room(name=name, title=name, polygon=tuple(turn.apply(*corner) for corner in corners))

    def doorway(name: str, x: float) -> Passage:
        ends: list[Point] = [turn.apply(x - door / 2.0, 2.0), turn.apply(x + door / 2.0, 2.0)]
        return Passage(name=name, title=name, start=ends[0], end=ends[1], connects=("hall", name))

    doors = {"west": 1.5, "east": 7.0}
    edges = [0.0, *(x + side * door / 2.0 for x in doors.values() for side in (-1, 1)), 9.0]
    return FloorPlan(
        map_id="building",
        title="Building",
        rooms=(
            room("hall", 0.0, 0.0, 9.0, 2.0),
            room("west", 0.0, 2.0, 4.5, 6.0),
            room("east", 4.5, 2.0, 9.0, 6.0),
        ),
        walls=(
            wall(0.0, 0.0, 9.0, 0.0),
            wall(9.0, 0.0, 9.0, 6.0),
            wall(9.0, 6.0, 0.0, 6.0),
            wall(0.0, 6.0, 0.0, 0.0),
            wall(4.5, 2.0, 4.5, 6.0),
            *(wall(edges[n], 2.0, edges[n + 1], 2.0) for n in (0, 2, 4)),
        ),
        passages=tuple(doorway(name, x) for name, x in doors.items()),
        furniture=_furniture(turn) if furnished else (),
    )


def _furniture(turn: Pose2D) -> tuple[Furniture, ...]:
    """Return a table and a pillar that stand free, and a cabinet against a wall."""
    pieces = (
        ("table", 2.4, 4.2, 1.4, 0.8, "box"),
        ("pillar", 6.8, 4.3, 0.4, 0.4, "cylinder"),
        ("cabinet", 8.6, 5.3, 0.5, 1.0, "box"),
    )
    return tuple(
        Furniture(
            name=name,
            kind="box",
            shape=shape,
            x=turn.apply(x, y)[0],
            y=turn.apply(x, y)[1],
            theta=turn.theta,
            width=width,
            depth=depth,
            height=1.0,
        )
        for name, x, y, width, depth, shape in pieces
    )


def mapped(
    plan: FloorPlan,
    rng: np.random.Generator,
    *,
    resolution: float = 0.05,
    noise: bool = True,
    window: bool = False,
) -> OccupancyGrid:
    """Return the map that a robot makes of a plan."""
    grid = rasterise(plan, resolution)
    image = np.pad(grid.image, round(1.5 / resolution), constant_values=UNKNOWN)
    shift = -round(1.5 / resolution) * resolution
    if noise:
        image[(image == OCCUPIED) & (rng.random(image.shape) < GAPS)] = UNKNOWN
        image[(image == FREE) & (rng.random(image.shape) < SPECKLES)] = OCCUPIED
    origin = grid.transform.origin
    moved = replace(
        grid.transform,
        origin=Pose2D(origin.x + shift, origin.y + shift, 0.0),
        height=image.shape[0],
    )
    seen = OccupancyGrid(image, moved)
    return _with_window(seen, plan) if window else seen


def _with_window(grid: OccupancyGrid, plan: FloorPlan) -> OccupancyGrid:
    """Free cells beyond a wall in thin rays, as a laser behind glass sees them."""
    image = grid.image.copy()
    room = plan.rooms[2].polygon
    x, y = (room[2][0] + room[3][0]) / 2.0, (room[2][1] + room[3][1]) / 2.0
    for bearing in (-0.2, 0.1, 0.3):
        for far in np.arange(0.0, 1.3, grid.transform.resolution / 2.0).tolist():
            at = (x + far * math.sin(bearing), y + far * math.cos(bearing))
            row, column = grid.transform.to_cell(*at)
            image[row, column] = FREE
    return replace(grid, image=image)
