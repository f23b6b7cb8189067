"""Why there is no way, in one sentence that names the door when it is one."""

import math
from dataclasses import dataclass

import numpy as np

from robots.agent.navigation.obstacles.local_map import LocalObstacleMap
from robots.agent.navigation.planning.planner import Planner
from robots.api.floorplan import FloorPlan
from robots.world.sensing import Floats


@dataclass(frozen=True)
class ReasonParams:
    """Where it is looked for what blocks a route."""

    at_door: float = 0.8  # m from the middle of a doorway: the door is meant
    routes: int = 4  # that are examined
    one_thing: float = 0.8  # m about a blocked point that count as blocked for the same reason
    start_reach: float = 0.6  # m about a robot that has no room, for a place where it has


REASON = ReasonParams()


def what_blocks(
    obstacle_map: LocalObstacleMap,
    planner: Planner,
    plan: FloorPlan | None,
    *,
    way: tuple[tuple[float, float], tuple[float, float]],
    now: float,
) -> str:
    """Return why no way leads now from the one point of `way` to the other."""
    start, goal = way
    costmap = obstacle_map.costmap
    clearance = obstacle_map.clearance(now)
    if planner.place_near(*start, clearance, REASON.start_reach) is None:
        return "the robot is boxed in: it has no room to move"
    usual = planner.plan(start, goal, costmap.clearance)
    if usual is None:
        return "no way leads to the goal on the map"
    if float(costmap.sample(clearance, np.array([goal]))[0]) < costmap.least:
        return "something stands on the goal"
    found = list(
        dict.fromkeys(
            _at(obstacle_map, plan, spot, now)
            for spot in _spots(obstacle_map, planner, way, clearance)
        )
    )
    return f"blocked: {_and(found)}" if found else "the way is too narrow for the robot"


def _spots(
    obstacle_map: LocalObstacleMap,
    planner: Planner,
    way: tuple[tuple[float, float], tuple[float, float]],
    clearance: Floats,
) -> list[Floats]:
    """Return the points (2,) where the best ways on the map are blocked, one each."""
    costmap = obstacle_map.costmap
    spots = list[Floats]()
    known = np.zeros(obstacle_map.costmap.shape, dtype=np.bool_)
    for _ in range(REASON.routes):
        path = planner.plan(*way, costmap.clearance_with(known))
        if path is None:
            break
        tight = path.points[costmap.sample(clearance, path.points) < costmap.least]
        if len(tight) == 0:
            break
        spots.append(tight[0])
        rows, columns = np.nonzero(clearance <= 0.0)
        centres = costmap.centres(rows, columns)
        near = (
            np.hypot(centres[:, 0] - tight[0, 0], centres[:, 1] - tight[0, 1]) <= REASON.one_thing
        )
        known[rows[near], columns[near]] = True
    return spots


def _at(obstacle_map: LocalObstacleMap, plan: FloorPlan | None, spot: Floats, now: float) -> str:
    """Return the obstacle at a point (2,)."""
    x, y = float(spot[0]), float(spot[1])
    closed = obstacle_map.doors.closed(now)
    door = next(
        (
            door
            for door in (plan.doors if plan else ())
            if _distance(door.start, door.end, x, y) <= REASON.at_door
        ),
        None,
    )
    if door:
        return (
            f"{door.title} is closed"
            if door in closed
            else f"something stands in the doorway ({door.title})"
        )
    room = plan.room_at(x, y) if plan else None
    return f"something stands in the way at ({x:.1f}, {y:.1f})" + (
        f" in {room.title}" if room else ""
    )


def _distance(start: tuple[float, float], end: tuple[float, float], x: float, y: float) -> float:
    return math.dist(((start[0] + end[0]) / 2.0, (start[1] + end[1]) / 2.0), (x, y))


def _and(names: list[str]) -> str:
    return names[0] if len(names) == 1 else ", ".join(names[:-1]) + " and " + names[-1]
