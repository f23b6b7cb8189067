"""Cheapest paths over the free cells of a grid, by SciPy's Dijkstra.

The robot's planner, the bots that rehearse a study and the metrics that need a shortest path give
it a price for a metre in each cell; without one, a path costs its length.
"""

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]
Step = tuple[int, int]  # cells down, which is never negative, and to the right

# Half of the neighbours: each step is used in both directions.
KING: Sequence[Step] = ((0, 1), (1, 0), (1, 1), (1, -1))
# With the steps of a chess knight, a straight line is at most 3 % too long.
KNIGHT: Sequence[Step] = (*KING, (1, 2), (2, 1), (1, -2), (2, -1))


class CellGraph:
    """The free cells of a grid as nodes, and the steps between them as edges.

    Attributes:
        node: (h, w) the number of each free cell, row by row; -1 elsewhere.
        rows: (n,) the row of each node; `columns` its column.
    """

    def __init__(
        self, free: npt.NDArray[np.bool_], resolution: float, steps: Sequence[Step] = KING
    ) -> None:
        self.rows, self.columns = np.nonzero(free)
        self.node: Indices = np.full(free.shape, -1, dtype=np.intp)
        self.node[free] = np.arange(len(self.rows))
        first, second, lengths = [], [], []
        high, wide = free.shape
        for down, right in steps:
            here = self.node[: high - down, max(0, -right) : wide - max(0, right)]
            there = self.node[down:, max(0, right) : wide + min(0, right)]
            joined = (here >= 0) & (there >= 0)
            first += [here[joined], there[joined]]
            second += [there[joined], here[joined]]
            lengths.append(np.full(2 * int(joined.sum()), math.hypot(down, right) * resolution))
        # In the order of a sparse matrix, so that new prices only replace its values.
        begin, end = np.concatenate(first), np.concatenate(second)
        order = np.lexsort((end, begin))
        self._begin, self._end = begin[order], end[order].astype(np.int32)
        self._halves = np.concatenate(lengths)[order] / 2.0
        self._starts = np.searchsorted(self._begin, np.arange(len(self.rows) + 1)).astype(np.int32)

    def from_node(self, goal: int, price: Floats | None = None) -> tuple[Floats, Indices]:
        """Return (n,) what the cheapest path from each node to a goal costs, infinite where there
        is none, and (n,) the next node of that path.

        Args:
            goal: a node.
            price: (n,) of a metre at each node; infinite where a path must not pass.
        """
        prices = np.ones(len(self.rows)) if price is None else price
        weights = self._halves * (prices[self._begin] + prices[self._end])
        shape = (len(self.rows), len(self.rows))
        graph = csr_matrix((weights, self._end, self._starts), shape=shape)
        costs, following = dijkstra(graph, directed=True, indices=goal, return_predecessors=True)
        return costs, following

    def path(self, start: int, goal: int, price: Floats | None = None) -> list[int]:
        """Return the nodes of the cheapest path, both ends included; none when there is no path."""
        costs, following = self.from_node(goal, price)
        if not math.isfinite(float(costs[start])):
            return []
        nodes = [start]
        while nodes[-1] != goal:
            nodes.append(int(following[nodes[-1]]))
        return nodes
