"""The near points of the last few scans while the robot hardly moved: the nearest of several
measurements decides how much room there is.

The obstacle memory replaces what a scan measures again. A robot held by something at the edge of
its margin would look there scan after scan, until the error of one lets it a little nearer, and so
creep up to the thing on noise alone.
"""

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from robots.api.geometry import Pose2D
from robots.world.sensing import Floats, LaserScan, points_from_frame, points_in_frame


@dataclass(frozen=True)
class RecentSweepsParams:
    """Number and age of the sweeps that are kept."""

    sweeps: int = 5
    seconds: float = 0.6  # at most, for a laser that is slow
    near: float = 0.15  # m from the robot's farthest corner: what it may touch next
    # m and rad by which the robot has hardly moved since: sweeps from elsewhere have other errors,
    # and what moves far between two does not creep
    distance: float = 0.03
    turn: float = 0.05


RECENT = RecentSweepsParams()


class RecentSweeps:
    """Points of recent sweeps within reach of the robot, in the frame of the odometry."""

    def __init__(self, circumscribed: float, params: RecentSweepsParams = RECENT) -> None:
        self._params = params
        self._reach = circumscribed + params.near
        self._kept: deque[tuple[float, Pose2D, Floats]] = deque(maxlen=params.sweeps)

    def take(self, odometry: Pose2D, beams: LaserScan) -> None:
        points = beams.points()
        near = points[np.hypot(points[:, 0], points[:, 1]) <= self._reach]
        self._kept.append((beams.stamp, odometry, points_from_frame(odometry, near)))

    def near(self, odometry: Pose2D, now: float) -> Floats:
        """Return (n, 2) the points of sweeps from about there, in the robot's frame."""
        kept = [
            points
            for stamp, at, points in self._kept
            if now - stamp <= self._params.seconds and self._is_here(odometry.inverse().compose(at))
        ]
        return points_in_frame(odometry, np.concatenate(kept)) if kept else np.zeros((0, 2))

    def _is_here(self, moved: Pose2D) -> bool:
        params = self._params
        return math.hypot(moved.x, moved.y) <= params.distance and abs(moved.theta) <= params.turn
