"""Somebody who drives a simulated robot about a site without end, with the truth before their eyes
and no great care.

They pick a place, follow a way over the map to it, wait before people, and pick another place when
something stands in the way.
"""

import math

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from robots.api.geometry import Pose2D, wrap_angle
from robots.simulator.physics.simulation import Simulation, StartError
from robots.world.grid import OccupancyGrid

SPACING = 2  # cells of the map a step of a way
CLEARANCE = 0.42  # metres
STEPS = ((0, 1), (1, 0), (1, 1), (1, -1))
TICK = 0.02


class Ways:
    """A raster over the connected free space of a map, and shortest paths away from walls."""

    def __init__(self, grid: OccupancyGrid, clearance: float = CLEARANCE) -> None:
        room = (
            ndimage.distance_transform_edt(grid.free())[::SPACING, ::SPACING]
            * grid.transform.resolution
        )
        labels, _ = ndimage.label(room > clearance)
        places = labels == 1 + int(np.argmax(np.bincount(labels.ravel())[1:]))
        self.transform = grid.transform
        self.cells = np.argwhere(places)
        number = np.full(places.shape, -1)
        number[places] = np.arange(len(self.cells))
        self.graph = _graph(self.cells, number, room)

    def place(self, index: int) -> tuple[float, float]:
        """Return x, y of a cell in the world."""
        row, column = self.cells[index]
        return self.transform.to_world((column + 0.5) * SPACING, (row + 0.5) * SPACING)

    def anywhere(self, rng: np.random.Generator) -> tuple[float, float]:
        """Return x, y of some place."""
        return self.place(int(rng.integers(len(self.cells))))

    def nearest(self, x: float, y: float) -> int:
        """Return the cell that is nearest to a place of the world."""
        u, v = self.transform.to_pixel(x, y)
        return int(np.argmin(((self.cells + 0.5) * SPACING - (v, u)).__pow__(2).sum(axis=1)))

    def way(
        self, start: tuple[float, float], goal: tuple[float, float]
    ) -> list[tuple[float, float]]:
        """Return the places from start to goal, each some centimetres from the one before."""
        here, there = self.nearest(*start), self.nearest(*goal)
        _, towards = dijkstra(self.graph, indices=there, return_predecessors=True)
        found = [self.place(here)]
        while here != there:
            here = int(towards[here])
            found.append(self.place(here))
        return found


def _graph(cells: np.ndarray, number: np.ndarray, room: np.ndarray) -> coo_array:
    origins, ends, costs = [], [], []
    padded = np.pad(number, 1, constant_values=-1)
    for down, right in STEPS:
        end = padded[cells[:, 0] + down + 1, cells[:, 1] + right + 1]
        origin = np.flatnonzero(end >= 0)
        origins += [origin, end[origin]]
        ends += [end[origin], origin]
        costs += [math.hypot(down, right) * (1.0 + 0.3 / room[tuple(cells[origin].T)])] * 2
    return coo_array(
        (np.concatenate(costs), (np.concatenate(origins), np.concatenate(ends))),
        shape=(len(cells), len(cells)),
    ).tocsr()


class Wanderer:
    """Drives a simulation: `step()` lets `TICK` seconds pass."""

    def __init__(self, simulation: Simulation, ways: Ways, rng: np.random.Generator) -> None:
        self.simulation, self.ways, self.rng = simulation, ways, rng
        self.way: list[tuple[float, float]] = []
        self.pause = self.back = self.held = 0.0

    def step(self) -> None:
        """Steer, and let a tick pass."""
        self.simulation.command(*self._steer())
        self.simulation.step(TICK)

    def carry_away(self, least: float = 2.0) -> None:
        """Put the robot somewhere else, at least so many metres away, facing anywhere."""
        while True:
            x, y = self.ways.anywhere(self.rng)
            if self.simulation.pose.distance(Pose2D(x, y, 0.0)) < least:
                continue
            try:
                self.simulation.carry_to(Pose2D(x, y, float(self.rng.uniform(-math.pi, math.pi))))
            except StartError:
                continue
            self.way = []
            return

    def _steer(self) -> tuple[float, float]:
        if self.pause > 0.0:
            self.pause -= TICK
            return 0.0, 0.0
        if self.back > 0.0:
            self.back -= TICK
            return -0.2, 0.3
        return self._go_on()

    def _go_on(self) -> tuple[float, float]:
        pose = self.simulation.pose
        while self.way and math.dist(self.way[0], (pose.x, pose.y)) < 0.35:
            self.way.pop(0)
        if not self.way:
            self.way, self.pause = (
                self.ways.way((pose.x, pose.y), self.ways.anywhere(self.rng)),
                float(self.rng.uniform(0.0, 2.0)),
            )
        aside = wrap_angle(
            math.atan2(self.way[0][1] - pose.y, self.way[0][0] - pose.x) - pose.theta
        )
        turn = min(max(2.0 * aside, -0.7), 0.7)
        if self._is_somebody_ahead() or self.simulation.touching:
            return self._wait(turn)
        self.held = 0.0
        return max(0.0, 0.6 * (1.0 - abs(aside) / 0.8)), turn

    def _wait(self, turn: float) -> tuple[float, float]:
        self.held += TICK
        if self.held > 4.0:
            self.held, self.back, self.way = 0.0, 1.5, []
        return 0.0, 0.0 if self.simulation.touching else turn

    def _is_somebody_ahead(self) -> bool:
        inverse = self.simulation.pose.inverse()
        return any(
            0.0 < x < 0.9 and abs(y) < 0.5
            for x, y in (inverse.apply(person.x, person.y) for person in self.simulation.people)
        )


def standing_somewhere(simulation: Simulation, ways: Ways, rng: np.random.Generator) -> Wanderer:
    """Return a driver of a robot that was put anywhere."""
    wanderer = Wanderer(simulation, ways, rng)
    wanderer.carry_away(least=0.0)
    return wanderer
