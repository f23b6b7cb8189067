"""Charging stations proposed on a map: at the straight wall with the most room to back out. Map and
plan must have this wall at the same place, because a docked robot sees little but its station and
this wall, and localizes by them.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from robots.api.floorplan import ChargingDock, Station
from robots.api.geometry import Pose2D, wrap_angle
from robots.world.robot_models import MODELS, RobotModel
from robots.world.sensing import points_from_frame
from robots.world.tracing.structure import Structure
from robots.world.tracing.walls import Segment


@dataclass(frozen=True)
class DockParams:
    """The size of a station, and the room that it needs; metres."""

    ahead: float = 0.06  # of the docked robot's front
    width: float = 0.56
    depth: float = 0.12
    height: float = 0.5
    off_wall: float = 0.03  # between the station's back and the wall's face
    exit: float = 1.4  # straight back from the docked pose that must be free
    clearance: float = 0.42  # along the exit, to both sides
    plenty: float = 1.0  # from which more clearance is of no use
    beside: float = 0.15  # along the wall beyond each side of the station
    apart: float = 1.8  # between two stations
    off_map: float = 0.1  # of the plan's wall from the map's, or a cell if that is more
    on_map: float = 0.8  # share of the wall along which it is no more
    step: float = 0.25  # between places that are tried


DOCK = DockParams()


def propose_docks(
    structure: Structure, walls: list[Segment], title: str
) -> tuple[ChargingDock, ...]:
    """Return a station for each series of robots that one fits for, in the world's frame."""
    docks: list[ChargingDock] = []
    taken: list[Pose2D] = []
    for model in MODELS.values():
        best, most = None, (False, 0.0)
        poses = list(_candidates(walls, model))
        on_map = _has_wall(structure, poses, model) if poses else []
        for pose, room, wall in zip(poses, _clear_behind(structure, poses), on_map, strict=True):
            is_better = room > 0.0 and (wall, room - 1e-9) > most
            if not is_better or any(pose.distance(other) < DOCK.apart for other in taken):
                continue
            if _stands_free(structure, pose, model):
                best, most = pose, (wall, room)
        if best is not None:
            taken.append(best)
            docks.append(_dock(structure, best, model, f"{title} ({model.title})"))
    return tuple(docks)


def station_of(model: RobotModel) -> Station:
    """Return a usual station for a series of robots."""
    return Station(
        distance=round(max(x for x, _ in model.footprint) + DOCK.ahead, 3),
        width=DOCK.width,
        depth=DOCK.depth,
        height=DOCK.height,
    )


def _dock(structure: Structure, pose: Pose2D, model: RobotModel, title: str) -> ChargingDock:
    layers = structure.layers
    x, y = layers.to_world((pose.x, pose.y))
    return ChargingDock(
        name=f"{model.series}-dock",
        title=title,
        type=model.series,
        x=x,
        y=y,
        theta=round(wrap_angle(pose.theta + layers.world_from_map.theta), 4),
        station=station_of(model),
    )


def _candidates(walls: list[Segment], model: RobotModel) -> Iterator[Pose2D]:
    """Yield docked poses along both sides of the walls, nose to the wall, in the map's frame."""
    ahead = station_of(model).distance + DOCK.depth + DOCK.off_wall
    for wall in walls:
        reach = wall.length / 2.0 - DOCK.width / 2.0 - DOCK.beside
        if reach < 0.0:
            continue
        off = ahead + wall.thickness / 2.0
        for side in (1.0, -1.0):
            normal = wall.direction + side * math.pi / 2.0
            for along in np.linspace(-reach, reach, 1 + int(2.0 * reach / DOCK.step)).tolist():
                yield Pose2D(
                    wall.middle[0] + along * math.cos(wall.direction) + off * math.cos(normal),
                    wall.middle[1] + along * math.sin(wall.direction) + off * math.sin(normal),
                    wrap_angle(normal + math.pi),
                )


def _clear_behind(structure: Structure, poses: list[Pose2D]) -> list[float]:
    """Return the clearance in metres on the way out of a dock at each pose, 0 where there is too
    little.
    """
    layers = structure.layers
    back = np.arange(0.0, DOCK.exit + DOCK.step, layers.resolution)
    behind = np.column_stack([-back, np.zeros_like(back)])
    points = np.array([points_from_frame(pose, behind) for pose in poses]).reshape(-1, 2)
    clearance = layers.values_at(structure.floor_clearance, points, 0.0)
    least = clearance.reshape(len(poses), len(back)).min(axis=1)
    rooms: list[float] = np.where(
        least >= DOCK.clearance, np.minimum(least, DOCK.plenty), 0.0
    ).tolist()
    return rooms


def _has_wall(structure: Structure, poses: list[Pose2D], model: RobotModel) -> list[bool]:
    """Tell of each pose whether the map has the face of the wall behind the station."""
    layers = structure.layers
    half = DOCK.width / 2.0 + DOCK.beside
    aside = np.linspace(-half, half, 1 + round(2.0 * half / layers.resolution))
    ahead = np.full_like(aside, station_of(model).distance + DOCK.depth + DOCK.off_wall)
    face = np.column_stack([ahead, aside])
    points = np.concatenate([points_from_frame(pose, face) for pose in poses])
    off = layers.values_at(layers.clearance(~structure.building), points, math.inf)
    near = off <= max(DOCK.off_map, layers.resolution)
    found: list[bool] = (near.reshape(len(poses), len(aside)).mean(axis=1) >= DOCK.on_map).tolist()
    return found


def _stands_free(structure: Structure, pose: Pose2D, model: RobotModel) -> bool:
    """Tell whether the place of the station is free, up to two cells before the wall."""
    layers = structure.layers
    front = station_of(model).distance
    deep = np.arange(0.0, front + DOCK.depth - layers.resolution, layers.resolution)
    wide = np.linspace(-DOCK.width / 2.0, DOCK.width / 2.0, 9)
    x, y = (values.ravel() for values in np.meshgrid(deep, wide))
    return bool(layers.at(layers.free, points_from_frame(pose, np.column_stack([x, y]))).all())
