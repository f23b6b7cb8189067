"""The cheapest route over a cost map: Dijkstra over the cells, then straight lines where they cost
no more, then rounded corners.

The graph of the map's free cells is made once; live obstacles only change the weights of its edges,
to infinity where the robot cannot be. scipy's Dijkstra needs 3 to 5 ms for the 22,000 cells of an
office of 12 m x 8 m, a tenth of a heuristic search in Python.
"""

import math
from dataclasses import dataclass

import numpy as np

from robots.agent.navigation.planning.centring import centred_on_map
from robots.agent.navigation.planning.costmap import Bools, CostMap, NoWayError
from robots.agent.navigation.planning.path import PlannedPath, resampled
from robots.api.reasons import ReasonCode
from robots.world.cell_graph import CellGraph
from robots.world.sensing import Floats


@dataclass(frozen=True)
class PlannerParams:
    """How a way is searched and made straight."""

    goal_reach: float = 0.5  # m within which the nearest place replaces a goal in a wall
    start_reach: float = 0.6  # m within which a robot that touches something looks for its way out
    dearer: float = 1.02  # times the cells that it replaces, which a straight line may cost
    smoothing_rounds: int = 40  # at most
    at_an_end: float = 0.12  # m from an end of a way: a point of it and a little more
    attempts: int = 4  # until the footprint fits everywhere on a way


PLANNER = PlannerParams()


class Planner:
    """Ways over one cost map."""

    def __init__(self, costmap: CostMap) -> None:
        self.costmap = costmap
        self._graph = CellGraph(costmap.clearance >= costmap.least, costmap.transform.resolution)
        self._rim = _rim(costmap.footprint)

    def place_near(
        self, x: float, y: float, clearance: Floats, reach: float
    ) -> tuple[float, float] | None:
        """Return a free point, else the nearest free cell within `reach` metres, or None."""
        if float(self.costmap.sample(clearance, np.array([[x, y]]))[0]) >= self.costmap.least:
            return x, y
        centres = self.costmap.centres(self._graph.rows, self._graph.columns)
        distances = np.hypot(centres[:, 0] - x, centres[:, 1] - y)
        distances[clearance[self._graph.rows, self._graph.columns] < self.costmap.least] = math.inf
        nearest = int(np.argmin(distances))
        if distances[nearest] > reach:
            return None
        return float(centres[nearest, 0]), float(centres[nearest, 1])

    def goal(self, x: float, y: float) -> tuple[float, float]:
        """Return a free place for a goal: there, or nearby; raises NoWayError."""
        if not (math.isfinite(x) and math.isfinite(y)):
            raise NoWayError(ReasonCode.NO_GOAL)
        if not bool(self.costmap.cells(np.array([[x, y]]))[2][0]):
            raise NoWayError(ReasonCode.OUTSIDE.of(f"({x:.1f}, {y:.1f})"))
        found = self.place_near(x, y, self.costmap.clearance, PLANNER.goal_reach)
        if found is None:
            raise NoWayError(ReasonCode.IN_WALL.of(f"({x:.1f}, {y:.1f})"))
        return found

    def plan(
        self, start: tuple[float, float], goal: tuple[float, float], clearance: Floats
    ) -> PlannedPath | None:
        """Return the way from start to goal through `clearance` (h, w), or None."""
        begin = self.place_near(*start, clearance, PLANNER.start_reach)
        at_goal = float(self.costmap.sample(clearance, np.array([goal]))[0])
        if begin is None or at_goal < self.costmap.least:
            return None
        cost = self.costmap.cost(clearance)
        for _ in range(PLANNER.attempts):
            cells = self._cheapest(begin, goal, cost)
            if cells is None:
                return None
            corners = self._straightened(np.vstack([[begin], cells[1:-1], [goal]]), cost)
            line = self._rounded(corners, cost)
            stuck = self._misfits(line, clearance)
            if not stuck.any():
                return self._centred(PlannedPath(resampled(np.vstack([[start], line]))), clearance)
            rows, columns, _ = self.costmap.cells(line[stuck])
            cost[rows, columns] = math.inf
        return None

    def straight(
        self, start: tuple[float, float], goal: tuple[float, float], clearance: Floats
    ) -> bool:
        """Tell whether the robot fits everywhere on the straight line between two points."""
        line = _line(np.array(start), np.array(goal), self.costmap.transform.resolution / 2.0)
        return bool((self.costmap.sample(clearance, line) >= self.costmap.least).all())

    def line(self, start: tuple[float, float], goal: tuple[float, float]) -> PlannedPath:
        return PlannedPath(resampled(np.array([start, goal])))

    def _cheapest(
        self, start: tuple[float, float], goal: tuple[float, float], cost: Floats
    ) -> Floats | None:
        """Return the centres (n, 2) of the cells of the cheapest way."""
        start_node, goal_node = self._graph.node[self.costmap.cells(np.array([start, goal]))[:2]]
        if min(start_node, goal_node) < 0:
            return None
        price = cost[self._graph.rows, self._graph.columns]
        nodes = self._graph.path(int(start_node), int(goal_node), price)
        if not nodes:
            return None
        return self.costmap.centres(self._graph.rows[nodes], self._graph.columns[nodes])

    def _straightened(self, line: Floats, cost: Floats) -> Floats:
        """Return corners (m, 2) with straight legs instead of cells, if that costs no more."""
        here_cost = self.costmap.sample(cost, line)
        steps = np.hypot(*np.diff(line, axis=0).T) * (here_cost[:-1] + here_cost[1:]) / 2.0
        prices = np.concatenate([[0.0], np.cumsum(steps)])
        corners, here = [0], 0
        while here < len(line) - 1:
            good, stride = here + 1, 2
            while stride >= 1:
                ahead = min(good + stride, len(line) - 1)
                allowed = PLANNER.dearer * (prices[ahead] - prices[here])
                if ahead > good and self._price(line[here], line[ahead], cost) <= allowed:
                    good, stride = ahead, stride * 2
                else:
                    stride //= 2
            corners.append(good)
            here = good
        return line[corners]

    def _price(self, start: Floats, end: Floats, cost: Floats) -> float:
        line = _line(start, end, self.costmap.transform.resolution / 2.0)
        rows, columns, _ = self.costmap.cells(line)
        return float(cost[rows, columns].mean()) * math.dist(start, end)

    def _rounded(self, corners: Floats, cost: Floats) -> Floats:
        """Return the line every 10 cm, corners rounded where the floor there is no dearer."""
        line = resampled(corners, 0.1)
        for _ in range(PLANNER.smoothing_rounds if len(line) > 2 else 0):
            moved = line.copy()
            moved[1:-1] += 0.25 * (line[:-2] + line[2:] - 2.0 * line[1:-1])
            allowed = np.maximum(self.costmap.sample(cost, line) * 1.1, 1.3)
            dearer = self.costmap.sample(cost, moved) > allowed
            moved[dearer] = line[dearer]
            line = moved
        return line

    def _centred(self, path: PlannedPath, clearance: Floats) -> PlannedPath:
        """Return the path in the middle of its narrow places, where the robot fits there."""
        costmap = self.costmap
        line = centred_on_map(path.points, path.along, clearance, costmap)
        before = costmap.sample(clearance, path.points)
        enough = np.minimum(before, costmap.least - costmap.transform.resolution / 2.0)
        worse = costmap.sample(clearance, line) < enough
        line = np.where(worse[:, None], path.points, line)
        return path if self._misfits(line, clearance).any() else PlannedPath(resampled(line))

    def _misfits(self, line: Floats, clearance: Floats) -> Bools:
        """Tell at which points (n, 2) of a line the footprint, heading along it, does not fit."""
        tight = self.costmap.sample(clearance, line) < self.costmap.circumscribed
        # A robot may begin and end beside something, where it turns as it must; what it would touch
        # there stops it (safety/collision/braking.py).
        tight &= np.hypot(*(line - line[0]).T) > PLANNER.at_an_end
        tight &= np.hypot(*(line - line[-1]).T) > PLANNER.at_an_end
        if len(line) < 2 or not tight.any():
            return np.zeros(len(line), dtype=np.bool_)
        along = np.gradient(line, axis=0)
        headings = np.arctan2(along[:, 1], along[:, 0])[tight]
        cosine, sine = np.cos(headings)[:, None], np.sin(headings)[:, None]
        x = line[tight, 0:1] + cosine * self._rim[:, 0] - sine * self._rim[:, 1]
        y = line[tight, 1:2] + sine * self._rim[:, 0] + cosine * self._rim[:, 1]
        at_rim = self.costmap.sample(clearance, np.column_stack([x.ravel(), y.ravel()]))
        stuck = np.zeros(len(line), dtype=np.bool_)
        stuck[tight] = (at_rim.reshape(x.shape) <= 0.0).any(axis=1)
        return stuck


def _line(start: Floats, end: Floats, spacing: float) -> Floats:
    count = max(2, math.ceil(math.dist(start, end) / spacing) + 1)
    return start + np.linspace(0.0, 1.0, count)[:, None] * (end - start)


def _rim(footprint: Floats) -> Floats:
    """Return the corners of a footprint and the middles of its sides."""
    return np.vstack([footprint, (footprint + np.roll(footprint, -1, axis=0)) / 2.0])
