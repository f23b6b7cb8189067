"""Obstacles that are not on the map (things, people, closed doors), marked where the laser met
them.

A cell is marked while something is seen in it, and free again when the laser looks through it. Out
of sight, what was there for long is kept for long, and what was passing is soon dropped. What has
not been still for `settled` seconds may be a walking person.
"""

from dataclasses import dataclass

import numpy as np

from robots.agent.navigation.obstacles.doors import DoorWatch
from robots.agent.navigation.planning.costmap import Bools, Cells, CostMap
from robots.agent.safety.collision.memory import sees
from robots.api.floorplan import FloorPlan
from robots.api.geometry import Pose2D
from robots.world.sensing import Floats, LaserScan, points_from_frame, points_in_frame
from robots.world.solids import leaf_end


@dataclass(frozen=True)
class LocalMapParams:
    """Parameters of marking laser points on the map, and of keeping the marks."""

    on_map: float = 0.2  # m: points so close to something of the map are part of it
    marked: float = 4.0  # m up to which the laser is trusted to mark a cell
    seen_through: float = 0.15  # m before the end of a beam, from which its way counts as free
    nearest_cell: float = 0.05  # m: a cell that is nearer is taken to be seen from there
    sure: float = 2.0  # m: what was marked from farther off is worth a closer look
    noted: float = 0.8  # m: obstacles so near may hold the robot
    settled: float = 10.0  # s after which a still obstacle counts as a thing
    flicker: float = 1.0  # s: a mark that returns within this time was never away
    # s: the same of one that no beam has passed since; the edge of what counts as the map's falls
    # into the next cell at times
    unpassed: float = 5.0
    kept_at_least: float = 5.0  # s out of sight
    kept_at_most: float = 60.0  # s out of sight
    kept_by_age: float = 10.0  # s out of sight for each second of standing there


LOCAL_MAP = LocalMapParams()
AROUND = np.indices((3, 3)).reshape(2, 9, 1) - 1  # rows and columns of a cell and its neighbours
NEVER = -1e12  # s


class LocalObstacleMap:
    """The map of `costmap` with what was seen lately."""

    def __init__(
        self, costmap: CostMap, plan: FloorPlan | None, params: LocalMapParams = LOCAL_MAP
    ) -> None:
        self.costmap = costmap
        self._params = params
        self.doors = DoorWatch(plan)
        self._there = np.zeros(costmap.shape, dtype=np.bool_)
        self._first = np.full(costmap.shape, NEVER)
        self._last = np.full(costmap.shape, NEVER)
        self._asked: tuple[Pose2D, Floats, Floats, tuple[Cells, Cells, Bools]] | None = None
        self._known: tuple[Bools, Floats] | None = None
        self._leaves = [
            np.array([door.start, leaf_end(door, "open")]) for door in (plan.doors if plan else ())
        ]

    def forget(self) -> None:
        """Forget everything that is not on the map."""
        self._there[:] = False
        self._first[:] = self._last[:] = NEVER
        self.doors.forget()

    def look(self, robot: Pose2D, beams: LaserScan, now: float) -> None:
        """Take a sweep that was measured at `robot`, the pose in the map."""
        params = self._params
        if not sees(beams):
            return
        laser = robot.compose(beams.mount)
        self.doors.look(laser, beams, now)
        self._clear(laser, beams)
        hits, (rows, columns, inside) = self._cells(robot, beams.points())
        which = np.flatnonzero(inside & (self.costmap.clearance[rows, columns] > params.on_map))
        which = which[np.hypot(hits[which, 0] - laser.x, hits[which, 1] - laser.y) <= params.marked]
        self._mark(rows[which], columns[which], now)

    def note(self, robot: Pose2D, points: Floats, now: float) -> None:
        """Mark points (n, 2) in the robot's frame that keep it from moving."""
        params = self._params
        close = points[np.hypot(points[:, 0], points[:, 1]) <= params.noted]
        rows, columns, inside = self.costmap.cells(points_from_frame(robot, close))
        which = inside & (self.costmap.clearance[rows, columns] > params.on_map / 2.0)
        self._mark(rows[which], columns[which], now)

    def live(self, now: float) -> Bools:
        """Return (h, w), True where something stands that is not on the map."""
        live = np.zeros(self.costmap.shape, dtype=np.bool_)
        rows, columns = self._live_cells(now)
        live[rows, columns] = True
        return live

    def _live_cells(self, now: float) -> tuple[Cells, Cells]:
        """Return rows and columns of the same, some perhaps more than once."""
        params = self._params
        there = np.flatnonzero(self._there)
        first, last = self._first.ravel()[there], self._last.ravel()[there]
        kept = params.kept_at_least + np.maximum(params.kept_by_age * (last - first), 0.0)
        kept = np.minimum(kept, params.kept_at_most)
        rows, columns = np.divmod(there[now - last <= kept], self.costmap.shape[1])
        leaf_rows, leaf_columns, inside = self.costmap.cells(self.doors.leaves(now))
        columns = np.concatenate([columns, leaf_columns[inside]])
        return np.concatenate([rows, leaf_rows[inside]]), columns

    def clearance(self, now: float) -> Floats:
        """Return (h, w) the distance in metres to the nearest thing, on the map or not."""
        return self._clearance_with(self.live(now))

    def room_at(self, points: Floats, now: float) -> Floats:
        """Return `clearance` (n,) at a few map points (n, 2), faster than the whole map."""
        rows, columns, inside = self.costmap.cells(points)
        room: Floats = np.where(inside, self.costmap.clearance[rows, columns], 0.0)
        down, right = self._live_cells(now)
        if len(down) == 0:
            return room
        nearest = ((rows[:, None] - down) ** 2 + (columns[:, None] - right) ** 2).min(axis=1)
        resolution = self.costmap.transform.resolution
        beside: Floats = np.maximum(np.sqrt(nearest) * resolution - resolution / 2.0, 0.0)
        return np.minimum(room, beside)

    def _clearance_with(self, live: Bools) -> Floats:
        """Return the clearance with live cells; cached, because often nothing has changed."""
        if self._known is None or not np.array_equal(self._known[0], live):
            self._known = live, self.costmap.clearance_with(live)
        return self._known[1]

    def clearance_nearby(self, robot: Pose2D, now: float) -> Floats:
        """Return the clearance without marks beyond `sure` metres, except closed doors."""
        live = self.live(now)
        rows, columns = np.nonzero(live)
        spots = self.costmap.centres(rows, columns)
        far = np.hypot(spots[:, 0] - robot.x, spots[:, 1] - robot.y) > self._params.sure
        live[rows[far], columns[far]] = False
        leaves, across, inside = self.costmap.cells(self.doors.leaves(now))
        live[leaves[inside], across[inside]] = True
        return self._clearance_with(live)

    def strange(self, robot: Pose2D, points: Floats, now: float) -> Bools:
        """Tell which points (n, 2) in the robot's frame are neither on the map nor of a door."""
        seen, (rows, columns, inside) = self._cells(robot, points)
        result: Bools = inside & (self.costmap.clearance[rows, columns] > self._params.on_map)
        which = np.flatnonzero(result)
        if len(which):
            result[which[self._leaf(seen[which], now)]] = False
        return result

    def _cells(self, robot: Pose2D, points: Floats) -> tuple[Floats, tuple[Cells, Cells, Bools]]:
        """Return points (n, 2) of the robot's frame on the map, and their cells; cached."""
        asked = self._asked
        if asked is None or asked[0] != robot or asked[1] is not points:
            seen = points_from_frame(robot, points)
            self._asked = asked = robot, points, seen, self.costmap.cells(seen)
        return asked[2], asked[3]

    def settled(self, robot: Pose2D, points: Floats, now: float) -> Bools:
        """Tell which points (n, 2) in the robot's frame were long occupied, give or take a cell."""
        rows, columns, _ = self.costmap.cells(points_from_frame(robot, points))
        high, wide = self.costmap.shape
        down = np.minimum(np.maximum(rows + AROUND[0], 0), high - 1)
        right = np.minimum(np.maximum(columns + AROUND[1], 0), wide - 1)
        is_old = now - self._first[down, right] >= self._params.settled
        result: Bools = (self._there[down, right] & is_old).any(axis=0)
        return result

    def _leaf(self, points: Floats, now: float) -> Bools:
        """Tell which map points (n, 2) lie on a door's leaf, open or closed."""
        if not self._leaves:
            return np.zeros(len(points), dtype=np.bool_)
        closed = {door.name for door in self.doors.closed(now)}
        doors = zip(self.doors.doors, self._leaves, strict=True)
        ends = [[door.start, door.end] if door.name in closed else leaf for door, leaf in doors]
        lines = np.array(ends)
        result: Bools = np.logical_or.reduce(_beside(points, lines) <= self._params.on_map, axis=0)
        return result

    def _clear(self, laser: Pose2D, beams: LaserScan) -> None:
        """Free marked cells that a beam passes; only these few are checked."""
        params = self._params
        rows, columns = np.nonzero(self._there)
        if len(rows) == 0:
            return
        seen = points_in_frame(laser, self.costmap.centres(rows, columns))
        distances = np.hypot(seen[:, 0], seen[:, 1])
        bearings = np.arctan2(seen[:, 1], seen[:, 0]) - beams.angle_min
        bearings = (np.sign(beams.angle_increment) * bearings) % (2.0 * np.pi)
        # of the angle under which a cell is seen
        half = self.costmap.transform.resolution / 2.0 / np.maximum(distances, params.nearest_cell)
        step, last = abs(beams.angle_increment), len(beams.ranges) - 1
        index = np.rint(bearings / step).astype(np.intp)
        free = np.minimum(beams.ranges, beams.range_max) - params.seen_through
        free = np.minimum(free, params.marked)
        passed = np.zeros(len(rows), dtype=np.bool_)
        for beside in (0, -1, 1):
            beam = index + beside
            met = np.abs(beam * step - bearings) <= np.maximum(half, step / 2.0)
            met &= (beam >= 0) & (beam <= last)
            passed |= met & (free[np.minimum(np.maximum(beam, 0), last)] > distances)
        self._there[rows[passed], columns[passed]] = False

    def _mark(self, rows: Cells, columns: Cells, now: float) -> None:
        params = self._params
        returns = np.where(self._there[rows, columns], params.unpassed, params.flicker)
        new = now - self._last[rows, columns] > returns
        self._first[rows[new], columns[new]] = now
        self._last[rows, columns] = now
        self._there[rows, columns] = True


def moved(points: Floats, before: Pose2D, after: Pose2D) -> Floats:
    """Return points (n, 2) seen from `before` as seen from `after`, poses of one frame."""
    return points_in_frame(after, points_from_frame(before, points))


def _beside(points: Floats, lines: Floats) -> Floats:
    """Return the distances (m, n) of points (n, 2) to segments (m, 2, 2)."""
    along = lines[:, 1] - lines[:, 0]
    dx, dy = points[:, 0] - lines[:, 0, :1], points[:, 1] - lines[:, 0, 1:]
    ax, ay = along[:, :1], along[:, 1:]
    share = np.minimum(np.maximum((dx * ax + dy * ay) / (ax * ax + ay * ay), 0.0), 1.0)
    distances: Floats = np.hypot(dx - share * ax, dy - share * ay)
    return distances
