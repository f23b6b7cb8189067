"""People who walked out of the laser's sight a moment ago and may be beside or behind the robot.

A laser of 180 or 240 degrees loses people when they pass. For `hold` seconds they still count as
walking, where they were last seen, so that the robot lets them pass.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np

from robots.api.geometry import Pose2D
from robots.world.sensing import Floats, LaserScan, points_from_frame, points_in_frame


@dataclass(frozen=True)
class LostObstacleParams:
    """Whom the robot remembers when they walk out of its sight."""

    hold: float = 2.5  # s
    near: float = 1.6  # m from the robot, within which a person is remembered
    points: int = 12  # of a sweep, at most


LOST = LostObstacleParams()


class LostObstacles:
    """Points of people, in the frame of the odometry, with the times at which they were seen."""

    def __init__(self, params: LostObstacleParams = LOST) -> None:
        self._params = params
        self._seen: deque[tuple[float, Floats]] = deque()

    def take(self, stamp: float, odometry: Pose2D, walkers: Floats) -> None:
        """Take the points (n, 2) of walkers in a sweep, in the robot's frame at `odometry`."""
        params = self._params
        near = walkers[np.hypot(walkers[:, 0], walkers[:, 1]) <= params.near]
        if len(near):
            some = near[:: max(1, len(near) // params.points)]
            self._seen.append((stamp, points_from_frame(odometry, some)))

    def out_of_sight(self, now: float, odometry: Pose2D, beams: LaserScan) -> Floats:
        """Return points (m, 2) in the robot's frame that the laser no longer covers."""
        while self._seen and now - self._seen[0][0] > self._params.hold:
            self._seen.popleft()
        if not self._seen:
            return np.zeros((0, 2))
        points = points_in_frame(odometry, np.vstack([points for _, points in self._seen]))
        from_laser = points_in_frame(beams.mount, points)
        bearings = np.arctan2(from_laser[:, 1], from_laser[:, 0])
        turned = (bearings - float(beams.angles[0])) % (2.0 * np.pi)
        hidden: Floats = points[turned > abs(float(beams.angles[-1] - beams.angles[0]))]
        return hidden
