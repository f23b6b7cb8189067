"""Why there is no way, with the door or the room when it is one."""

import math
from dataclasses import dataclass

import numpy as np

from robots.agent.navigation.obstacles.local_map import LocalObstacleMap
from robots.agent.navigation.planning.planner import Planner
from robots.api.floorplan import FloorPlan
from robots.api.reasons import ReasonCode
from robots.world.sensing import Floats

Ends = tuple[tuple[float, float], tuple[float, float]]


@dataclass(frozen=True)
class ReasonParams:
    """Where the obstacles of a blocked route are searched."""

    at_door: float = 0.8  # m from the middle of a doorway: the door is meant
    routes: int = 4  # that are examined
    one_thing: float = 0.8  # m about a blocked point that count as blocked for the same reason
    start_reach: float = 0.6  # m about a robot that has no room, for a place where it has


REASON = ReasonParams()


def what_blocks(
    obstacle_map: LocalObstacleMap,
    planner: Planner,
    plan: FloorPlan | None,
    ends: Ends,
    now: float,
) -> str:
    """Return why no route leads now from the start to the goal of `ends`."""
    start, goal = ends
    costmap = obstacle_map.costmap
    clearance = obstacle_map.clearance(now)
    if planner.place_near(*start, clearance, REASON.start_reach) is None:
        return ReasonCode.BOXED_IN
    usual = planner.plan(start, goal, costmap.clearance)
    if usual is None:
        return ReasonCode.NO_WAY
    if float(costmap.sample(clearance, np.array([goal]))[0]) < costmap.least:
        return ReasonCode.GOAL_TAKEN
    spots = _spots(obstacle_map, planner, ends, clearance)
    found = list(dict.fromkeys(_at(obstacle_map, plan, spot, now) for spot in spots))
    if not found:
        return ReasonCode.TOO_NARROW
    return found[0] if len(found) == 1 else ReasonCode.ALL_BLOCKED.of(", ".join(found))


def _spots(
    obstacle_map: LocalObstacleMap, planner: Planner, ends: Ends, clearance: Floats
) -> list[Floats]:
    """Return the points (2,) where the best ways on the map are blocked, one each."""
    costmap = obstacle_map.costmap
    spots = list[Floats]()
    known = np.zeros(obstacle_map.costmap.shape, dtype=np.bool_)
    for _ in range(REASON.routes):
        path = planner.plan(*ends, costmap.clearance_with(known))
        if path is None:
            break
        tight = path.points[costmap.sample(clearance, path.points) < costmap.least]
        if len(tight) == 0:
            break
        spots.append(tight[0])
        rows, columns = np.nonzero(clearance <= 0.0)
        centres = costmap.centres(rows, columns)
        near = np.hypot(*(centres - tight[0]).T) <= REASON.one_thing
        known[rows[near], columns[near]] = True
    return spots


def _at(obstacle_map: LocalObstacleMap, plan: FloorPlan | None, spot: Floats, now: float) -> str:
    """Return the obstacle at a point (2,)."""
    x, y = float(spot[0]), float(spot[1])
    for door in plan.doors if plan else ():
        middle = (door.start[0] + door.end[0]) / 2.0, (door.start[1] + door.end[1]) / 2.0
        if math.dist(middle, (x, y)) <= REASON.at_door:
            if door in obstacle_map.doors.closed(now):
                return ReasonCode.DOOR_CLOSED.of(door.title)
            return ReasonCode.DOORWAY.of(door.title)
    room = plan.room_at(x, y) if plan else None
    if room is None:
        return ReasonCode.ALL_BLOCKED.of(f"({x:.1f}, {y:.1f})")
    return ReasonCode.IN_THE_WAY.of(room.title)
