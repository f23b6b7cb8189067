"""Where a journey to a point would lead, without starting it."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import label

from robots.agent.navigation.obstacles.blocked_reason import Ends, what_blocks
from robots.agent.navigation.obstacles.local_map import LocalObstacleMap
from robots.agent.navigation.planning.planner import PLANNER, Planner
from robots.api.floorplan import FloorPlan
from robots.api.reasons import ReasonCode
from robots.world.sensing import Floats

NO_ROUTE: Floats = np.zeros((0, 2))
KING = np.ones((3, 3))  # a cell is connected with its eight neighbours, as in the planner's graph


@dataclass(frozen=True)
class PreviewParams:
    """Which place is offered instead of a point that cannot be reached."""

    beside: float = 1.0  # m from the point, at most
    at: float = 0.25  # m from a point that can be reached, for a place with more room
    turns: float = 0.05  # m beyond the circumscribed radius: there the robot can turn
    nearer: float = 0.1  # m from the point that a metre less from the robot is worth
    spacing: float = 0.1  # m between two points of the line
    points: int = 300  # at most


PREVIEW = PreviewParams()


def preview(
    obstacle_map: LocalObstacleMap, planner: Planner, plan: FloorPlan | None, ends: Ends, now: float
) -> tuple[Floats, str]:
    """Return the route (n, 2) from the start to the goal of `ends`, or to a place beside the goal,
    with the reason why it does not lead there; or no route, with the reason.
    """
    start, goal = ends
    costmap = obstacle_map.costmap
    if not all(map(math.isfinite, goal)):
        return NO_ROUTE, ReasonCode.NO_GOAL
    if not bool(costmap.cells(np.array([goal]))[2][0]):
        return NO_ROUTE, ReasonCode.OUTSIDE
    clearance = obstacle_map.clearance(now)
    begin = planner.place_near(*start, clearance, PLANNER.start_reach)
    if begin is None:
        return NO_ROUTE, ReasonCode.BOXED_IN
    end = _reachable_near(planner, clearance, begin, goal)
    path = None if end is None else planner.plan(start, end, clearance)
    if path is not None and math.dist(path.end, goal) <= PREVIEW.at:
        return _thinned(path.points, path.length), ""
    if float(costmap.sample(costmap.clearance, np.array([goal]))[0]) < costmap.least:
        reason: str = ReasonCode.IN_WALL
    else:
        reason = what_blocks(obstacle_map, planner, plan, ends, now)
    return (NO_ROUTE, reason) if path is None else (_thinned(path.points, path.length), reason)


def _reachable_near(
    planner: Planner, clearance: Floats, begin: tuple[float, float], goal: tuple[float, float]
) -> tuple[float, float] | None:
    """Return the goal or the best place beside it that the robot can get to from `begin`: one where
    it can turn, if there is one.
    """
    costmap = planner.costmap
    parts, _ = label(clearance >= costmap.least, structure=KING)
    rows, columns, _ = costmap.cells(np.array([begin, goal]))
    here = parts[rows[0], columns[0]]
    is_reachable = here == parts[rows[1], columns[1]]
    roomy = clearance >= costmap.circumscribed + PREVIEW.turns
    if is_reachable and roomy[rows[1], columns[1]]:
        return goal
    reach = PREVIEW.at if is_reachable else PREVIEW.beside
    for enough in (roomy, clearance >= costmap.least):
        places = costmap.centres(*np.nonzero((parts == here) & enough))
        places = places[np.hypot(*(places - goal).T) <= reach]
        if len(places):
            away = np.hypot(*(places - goal).T) + PREVIEW.nearer * np.hypot(*(places - begin).T)
            x, y = places[int(np.argmin(away))]
            return float(x), float(y)
        if is_reachable:
            return goal
    return None


def _thinned(line: Floats, length: float) -> Floats:
    """Return the line with fewer points, its ends among them."""
    count = min(PREVIEW.points, max(2, math.ceil(length / PREVIEW.spacing) + 1))
    return line[np.unique(np.linspace(0, len(line) - 1, count).round().astype(np.intp))]
