"""The newest pose on the map between two estimates: the last one, carried on by the odometry."""

from collections import deque
from dataclasses import dataclass, field

from robots.agent.safety.collision.odometry import interpolated
from robots.api.geometry import Pose2D
from robots.world.sensing import CENTRE, Estimate

KEPT = 60  # odometry readings


@dataclass
class PoseBuffer:
    """Odometry readings and their frame's pose on the map; times of one clock, in seconds."""

    _readings: deque[tuple[float, Pose2D]] = field(default_factory=lambda: deque(maxlen=KEPT))
    _map_from_odometry: Pose2D = CENTRE
    _stamp: float | None = None

    def take(self, now: float, odometry: Pose2D, estimate: Estimate) -> None:
        """Take the newest reading, and the newest estimate, which may be older."""
        self._readings.append((now, odometry))
        if estimate.stamp != self._stamp:
            self._stamp = estimate.stamp
            self._map_from_odometry = estimate.pose.compose(
                self.odometry_at(estimate.stamp).inverse()
            )

    @property
    def now(self) -> float | None:
        """The time of the newest reading, None before the first."""
        return self._readings[-1][0] if self._readings else None

    def pose(self) -> Pose2D:
        """Return the pose on the map at the newest reading."""
        return self._map_from_odometry.compose(self._readings[-1][1])

    def on_map(self, odometry: Pose2D) -> Pose2D:
        return self._map_from_odometry.compose(odometry)

    def odometry_at(self, stamp: float) -> Pose2D:
        """Return the odometry at a time, interpolated."""
        return interpolated(self._readings, stamp)
