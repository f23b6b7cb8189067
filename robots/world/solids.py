"""The solid things of a plan for collisions, the laser and the map: prisms over convex outlines."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from robots.api.floorplan import ChargingDock, Door, DoorState, FloorPlan, Furniture
from robots.api.geometry import Pose2D

Floats = npt.NDArray[np.float64]
# of a door: its state at rest, or its share of the swing, from 0, closed, to 1, open
Opening = DoorState | float
SolidKind = Literal["wall", "furniture", "station", "door", "person"]
ROUND = 16  # corners of a cylinder


@dataclass(frozen=True, eq=False)
class Solid:
    """A convex prism: `outline` (n, 2) in metres, counter-clockwise, from the floor up to `top`."""

    kind: SolidKind
    name: str
    outline: Floats
    top: float


def rectangle(pose: Pose2D, width: float, depth: float) -> Floats:
    """Return the (4, 2) corners, counter-clockwise, of a rectangle about `pose`: width along its x,
    depth along its y.
    """
    half_x, half_y = width / 2.0, depth / 2.0
    return np.array(
        [
            pose.apply(x, y)
            for x, y in ((-half_x, -half_y), (half_x, -half_y), (half_x, half_y), (-half_x, half_y))
        ]
    )


def disc(x: float, y: float, diameter: float, corners: int = ROUND) -> Floats:
    """Return a regular polygon (corners, 2) around a circle."""
    angles = (np.arange(corners) + 0.5) * (2.0 * math.pi / corners)
    radius = diameter / 2.0 / math.cos(math.pi / corners)
    return np.column_stack([x + radius * np.cos(angles), y + radius * np.sin(angles)])


def bar(start: tuple[float, float], end: tuple[float, float], thickness: float) -> Floats:
    """Return the (4, 2) outline of a straight wall or leaf: corners 0, 1 on its right side, 2, 3 on
    its left.
    """
    middle = Pose2D(
        (start[0] + end[0]) / 2.0,
        (start[1] + end[1]) / 2.0,
        math.atan2(end[1] - start[1], end[0] - start[0]),
    )
    return rectangle(middle, math.dist(start, end), thickness)


def furniture_solid(piece: Furniture) -> Solid:
    """Return a piece of furniture with its full outline from the floor up: a robot must not drive
    under it either.
    """
    if piece.shape == "cylinder":
        outline = disc(piece.x, piece.y, piece.width)
    else:
        outline = rectangle(Pose2D(piece.x, piece.y, piece.theta), piece.width, piece.depth)
    return Solid("furniture", piece.name, outline, piece.height)


def station_pose(dock: ChargingDock) -> Pose2D:
    """Return the centre of a station's body; its front looks back at the docked robot."""
    return Pose2D(dock.x, dock.y, dock.theta).compose(
        Pose2D(dock.station.distance + dock.station.depth / 2.0, 0.0, 0.0)
    )


def station_solid(dock: ChargingDock) -> Solid:
    """Return the body of a charging station."""
    body = dock.station
    outline = rectangle(station_pose(dock), body.depth, body.width)
    return Solid("station", dock.name, outline, body.height)


def leaf_turn(door: Door, opening: Opening) -> float:
    """Return by how many radians the leaf is turned about its hinge from where it is closed."""
    share = {"closed": 0.0, "open": 1.0}[opening] if isinstance(opening, str) else opening
    return door.swing * share


def leaf_end(door: Door, opening: Opening) -> tuple[float, float]:
    """Return where the free edge of the leaf is."""
    turn = leaf_turn(door, opening)
    if turn == 0.0:
        return door.end
    closed = math.atan2(door.end[1] - door.start[1], door.end[0] - door.start[0])
    return Pose2D(*door.start, closed + turn).apply(math.dist(door.start, door.end), 0.0)


def leaf_solid(door: Door, opening: Opening) -> Solid:
    """Return the leaf of a door."""
    outline = bar(door.start, leaf_end(door, opening), door.leaf)
    return Solid("door", door.name, outline, door.height)


def fixed_solids(plan: FloorPlan) -> tuple[Solid, ...]:
    """Return everything that never moves: walls, furniture, stations."""
    outlines = (bar(wall.start, wall.end, wall.thickness) for wall in plan.walls)
    return (
        *(Solid("wall", f"wall-{n}", each, plan.ceiling) for n, each in enumerate(outlines)),
        *(furniture_solid(piece) for piece in plan.furniture),
        *(station_solid(dock) for dock in plan.docks),
    )


def edges(solids: tuple[Solid, ...]) -> Floats:
    """Return the sides of solids (n, 4), see `sides`, one solid after the other."""
    return np.concatenate([np.zeros((0, 4)), *(sides(solid.outline) for solid in solids)])


def sides(outline: Floats) -> Floats:
    """Return the sides (n, 4) of an outline (n, 2) in its direction: x0, y0, x1, y1."""
    found = np.empty((len(outline), 4))
    found[:, :2] = outline
    found[:-1, 2:], found[-1, 2:] = outline[1:], outline[0]
    return found


def inside(outline: Floats, x: Floats, y: Floats) -> npt.NDArray[np.bool_]:
    """Tell for points of any shape whether they lie in a convex, counter-clockwise outline, its
    border included.
    """
    result = np.ones(x.shape, dtype=np.bool_)
    for ax, ay, bx, by in sides(outline).tolist():
        result &= (bx - ax) * (y - ay) - (by - ay) * (x - ax) >= 0.0
    return result
