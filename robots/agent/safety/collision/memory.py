"""Recent laser points, kept in place: a laser of 180 or 240 degrees is blind behind and beside the
robot.

Points are in the smooth frame of the odometry, which drifts only with the distance driven. So a
point is forgotten by the distance since it was seen, not by time: a robot that has stood at a wall
for an hour still knows the obstacles behind it. With the distance a point also becomes less exact
(`about`).

A scan replaces what it measures again, and removes what it sees through. One beam between two
others that end nearer sees through nothing (the edge of a wall), nor does a single scan (a lost
echo, the leg of a chair between two beams). A beam without an echo sees to the laser's full range,
except close to the laser, where many are blind. A scan with almost no echoes is of a covered or
broken laser and does not count (`seen`).

Where one beam ends near and the next one far, an object has an edge, and may extend behind it. So
an edge that leaves the view is kept with a hand's breadth of what it may hide, until the laser
looks there again. It lies on the line of sight, which touches a convex object and does not cut it,
so that what counts as solid is not less than the object's hidden flank.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from robots.api.geometry import Pose2D, wrap_angle
from robots.world.sensing import Floats, LaserScan, points_from_frame, points_in_frame

Bools = npt.NDArray[np.bool_]
SEEN_AFTER, DOUBTS = 2, 3  # columns of a stored point
SAME_BEARING = 1e-4  # rad: what a robot that stands measures again
SEES = 0.05  # a sweep with a smaller share of echoes than this is that of a laser that does not see


@dataclass(frozen=True)
class MemorySettings:
    radius: float = 4.0  # m about the robot
    cell: float = 0.025  # m: one point is kept in such a square
    distance: float = 6.0  # m driven since a point was seen, for which it is kept
    turn: float = 0.3  # m of that distance, which a radian of turning counts as
    close: float = 1.2  # m: what the robot may run into next
    # m for which that is kept: who goes to and fro in a corner drives far without seeing its back
    close_distance: float = 30.0
    margin: float = 0.1  # m by which a beam must pass a point to see through it
    blind: float = 0.3  # m from the laser, where no echo tells nothing
    doubts: int = 2  # sweeps that must see through a point
    jump: float = 1.0  # m of odometry between two scans: it restarted
    inexact: float = 0.02  # m that a point may be off, at most
    inexact_distance: float = 0.3  # m of that distance after which it may
    edge: float = 0.15  # m by which an edge is nearer than its neighbour
    edge_near: float = 1.5  # m from the laser, within which edges count
    behind: tuple[float, ...] = (0.04, 0.08)  # m for which an edge is taken to go on
    apart: float = 0.02  # m driven between two scans that are searched for edges
    sees: float = SEES  # share of beams with an echo that a valid scan needs


class RollingObstacleMap:
    """Recent laser points around the robot. `seen` is the stamp of the last valid scan, -inf
    before.
    """

    def __init__(self, settings: MemorySettings | None = None) -> None:
        self.settings = settings or MemorySettings()
        self.seen = -math.inf
        self._odometry: Pose2D | None = None
        self._travelled = 0.0
        # points are kept in a square of this many cells around the robot, so that no two cells
        # share an entry of the table
        width = 2.0 * (self.settings.radius + self.settings.jump)
        self._side = 1 << math.ceil(math.log2(width / self.settings.cell + 2.0))
        self._table = np.zeros(self._side**2, dtype=np.int32)
        self.forget()

    def __len__(self) -> int:
        return len(self._points)

    def forget(self) -> None:
        """Forget every point: the odometry started again, or the robot was carried."""
        # x, y, the distance driven when it was seen, how many sweeps have seen through it
        self._points: Floats = np.zeros((0, 4))
        # behind edges, out of sight: x, y, the distance driven when the edge was seen
        self._behind: Floats = np.zeros((0, 3))
        # the same of the last sweep that was searched for edges, which may still be in sight
        self._edges: Floats = np.zeros((0, 3))
        self._looked = -math.inf  # the distance driven at that sweep

    def update(self, odometry: Pose2D, beams: LaserScan) -> None:
        """Take a scan, and the odometry (pose in any smooth frame) at its stamp."""
        self._travel(odometry)
        if not sees(beams, self.settings.sees):
            return
        self.seen = beams.stamp
        self._look(odometry, beams)
        self._add(odometry, beams.points())
        self._leave(odometry, beams)

    def near(self, odometry: Pose2D, radius: float) -> Floats:
        """Return (n, 2) seen points within `radius` metres of the robot, in its frame at
        `odometry`.
        """
        return self._about(self._points, odometry, radius)[0]

    def about(self, odometry: Pose2D, radius: float) -> tuple[Floats, Floats]:
        """Return the same with what edges hide, and (n,) possible errors in metres, 0 for a point
        in view.
        """
        seen, off = self._about(self._points, odometry, radius)
        if len(self._behind) == 0:
            return seen, off
        hidden, more = self._about(self._behind, odometry, radius)
        return np.concatenate([seen, hidden]), np.concatenate([off, more])

    def _about(self, kept: Floats, odometry: Pose2D, radius: float) -> tuple[Floats, Floats]:
        local = points_in_frame(odometry, kept)
        close = np.flatnonzero(_square(local) <= radius * radius)
        since = (self._travelled - kept[close, SEEN_AFTER]) / self.settings.inexact_distance
        return local[close], self.settings.inexact * np.minimum(since, 1.0)

    def _travel(self, odometry: Pose2D) -> None:
        before, self._odometry = self._odometry, odometry
        if before is None:
            return
        moved = before.distance(odometry)
        if moved > self.settings.jump:
            self.forget()
        self._travelled += moved + self.settings.turn * abs(
            wrap_angle(odometry.theta - before.theta)
        )

    def _look(self, odometry: Pose2D, beams: LaserScan) -> None:
        """Drop points that this scan measures again or sees through, that are far away, or that
        were seen too long ago.
        """
        local, doubts = points_in_frame(odometry, self._points), self._points[:, DOUBTS]
        again, through = compare(local, beams, self.settings)
        doubts += 1.0
        doubts *= through
        squares = _square(local)
        far = squares > self.settings.radius**2
        is_close = squares < self.settings.close**2
        kept_for = np.where(is_close, self.settings.close_distance, self.settings.distance)
        old = self._points[:, SEEN_AFTER] < self._travelled - kept_for
        self._points = self._points[~(again | far | old | (doubts >= self.settings.doubts))]

    def _leave(self, odometry: Pose2D, beams: LaserScan) -> None:
        """Keep points that edges hid in the last sweep if they are out of view now; drop those in
        view, which this scan measures if they exist.
        """
        if self._travelled - self._looked < self.settings.apart:
            return
        kept, self._looked = np.concatenate([self._edges, self._behind]), self._travelled
        if len(kept):
            local = points_in_frame(odometry, kept)
            near = _square(local) < self.settings.close**2
            recent = kept[:, SEEN_AFTER] > self._travelled - self.settings.close_distance
            seen = in_view(points_in_frame(beams.mount, local), beams)
            self._behind = kept[near & recent & ~seen]
        hidden = behind_edges(beams, self.settings)
        self._edges = np.empty((len(hidden), 3))
        self._edges[:, :2] = points_from_frame(odometry, hidden)
        self._edges[:, SEEN_AFTER] = self._travelled

    def _add(self, odometry: Pose2D, local: Floats) -> None:
        """Add points (n, 2) in the robot's frame, the newest first, and keep one a cell."""
        local = local[_square(local) <= self.settings.radius**2]
        points = np.zeros((len(local) + len(self._points), 4))
        points[: len(local), :2] = points_from_frame(odometry, local)
        points[: len(local), SEEN_AFTER] = self._travelled
        points[len(local) :] = self._points
        cells = np.floor(points[:, :2] / self.settings.cell).astype(np.int32) & (self._side - 1)
        places = cells[:, 0] * self._side + cells[:, 1]
        numbers = np.arange(len(cells), dtype=np.int32)
        # of several points in a cell the first one is written last, and stays
        self._table[places[::-1]] = numbers[::-1]
        self._points = points[self._table[places] == numbers]


def _square(points: Floats) -> Floats:
    """Return the squared distances (n,) of points (n, 2) from the origin."""
    x, y = points[:, 0], points[:, 1]
    return x * x + y * y


def compare(points: Floats, beams: LaserScan, settings: MemorySettings) -> tuple[Bools, Bools]:
    """Tell for points (n, 2) in the robot's frame whether a scan measures them again, and whether
    it sees through them.
    """
    seen_from_laser = points_in_frame(beams.mount, points)
    distances = np.hypot(seen_from_laser[:, 0], seen_from_laser[:, 1])
    bearings = np.arctan2(seen_from_laser[:, 1], seen_from_laser[:, 0])
    turned = from_first_beam(bearings, beams)
    inside = turned <= from_first_to_last(beams)
    index = np.minimum(
        np.rint(turned / abs(beams.angle_increment)).astype(np.intp), len(beams.ranges) - 1
    )
    nearest = shortest_of_neighbours(np.minimum(beams.ranges, beams.range_max))
    echo = np.isfinite(beams.ranges)
    again = inside & echo[index] & (np.abs(beams.ranges[index] - distances) <= settings.margin)
    through = (
        inside
        & (nearest[index] > distances + settings.margin)
        & (echo[index] | (distances > settings.blind))
    )
    return again, through


def in_view(points: Floats, beams: LaserScan) -> Bools:
    """Tell for points (n, 2) in the laser's frame whether its beams span their direction."""
    bearings = np.arctan2(points[:, 1], points[:, 0])
    spanned: Bools = from_first_beam(bearings, beams) <= from_first_to_last(beams)
    return spanned


def from_first_beam(bearings: Floats, beams: LaserScan) -> Floats:
    """Return (n,) the angles of bearings in the laser's frame from the first beam, in the direction
    of the scan: [0, 2 pi).
    """
    direction = math.copysign(1.0, beams.angle_increment)
    turned: Floats = (bearings - beams.angle_min) * direction + SAME_BEARING
    return turned % (2.0 * math.pi)


def from_first_to_last(beams: LaserScan) -> float:
    """Return the angle from the first beam to the last.

    Not half a step more: the last beam measures nothing beyond itself. Otherwise a robot that turns
    by less than that between two scans would have each point beyond the last beam replaced by one
    on it, and leave nothing behind.
    """
    return abs(beams.angle_increment) * (len(beams.ranges) - 1) + 2.0 * SAME_BEARING


def behind_edges(beams: LaserScan, settings: MemorySettings) -> Floats:
    """Return (n, 2) points in the robot's frame that near edges in a scan hide."""
    near = beams.ranges < settings.edge_near
    if not near.any():
        return np.zeros((0, 2))
    ranges = np.minimum(beams.ranges, beams.range_max)
    padded = np.concatenate([ranges[:1], ranges, ranges[-1:]])
    which = np.flatnonzero(near & (np.maximum(padded[:-2], padded[2:]) - ranges >= settings.edge))
    ends, angles = ranges[which, None] + settings.behind, beams.angles[which, None]
    hidden = np.stack([ends * np.cos(angles), ends * np.sin(angles)], axis=-1)
    return points_from_frame(beams.mount, hidden.reshape(-1, 2))


def sees(beams: LaserScan, share: float = SEES) -> bool:
    """Tell whether a large enough share of a scan's beams has an echo."""
    echoes = int(np.count_nonzero(np.isfinite(beams.ranges)))
    return len(beams.ranges) > 0 and echoes >= share * len(beams.ranges)


def shortest_of_neighbours(ranges: Floats) -> Floats:
    """Return for each of (n,) ranges the shortest of it and its two neighbours."""
    padded = np.concatenate([ranges[:1], ranges, ranges[-1:]])
    shortest: Floats = np.minimum(np.minimum(padded[:-2], padded[1:-1]), padded[2:])
    return shortest
