"""The pose that a robot's own architecture reports, instead of our localizer's."""

import math

from robots.api.geometry import Pose2D
from robots.api.messages import Pose
from robots.world.sensing import Estimate, LaserScan


class ReportedLocalizer:
    """As `localizer.Localizer`, for a robot that reports its own pose."""

    def __init__(self) -> None:
        self._pose: Pose | None = None

    def report(self, pose: Pose | None) -> None:
        self._pose = pose

    def set_pose(self, pose: Pose2D, spread: float = 0.5, turn: float = math.radians(20.0)) -> None:
        """Do nothing: the architecture has the pose."""

    def forget(self) -> None:
        """Do nothing: the architecture has the pose."""

    def update(
        self, stamp: float, odometry: Pose2D, beams: LaserScan | None, *, docked: bool = False
    ) -> Estimate:
        """Return the last reported pose, as lost without one."""
        pose = self._pose
        if pose is None or not pose.localized:
            return Estimate(stamp, Pose2D(0.0, 0.0, 0.0), LOST, 0.0, localized=False)
        covariance, place = pose.covariance or EXACT, Pose2D(pose.x, pose.y, pose.theta)
        return Estimate(stamp, place, covariance, pose.score, localized=True)


LOST = (1e4, 0.0, 0.0, 1e4, 0.0, 10.0)
EXACT = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
