"""The robot's pose between two outputs of navigation: the newest one's, moved on by odometry."""

from robots.agent.autonomy.sensor_snapshot import NavigationOutput
from robots.agent.robot_interface import NOWHERE
from robots.api.geometry import Pose2D, wrap_angle
from robots.api.messages import Pose

STALE = 2.0  # seconds without an output after which dead reckoning is no localization
LARGEST = 1e9  # variances are capped: JSON knows no infinity


class PoseExtrapolator:
    """A moving robot's pose, from ten or twenty outputs a second."""

    def __init__(self) -> None:
        self._output: NavigationOutput | None = None
        self._map_from_odometry: Pose2D | None = None
        self._at = float("-inf")

    def take(self, output: NavigationOutput, now: float) -> None:
        """Take an output; `now` is monotonic time in seconds."""
        self._output, self._at = output, now
        self._map_from_odometry = output.pose.compose(output.odometry.inverse())

    @property
    def trusted(self) -> bool:
        return self._output is not None and self._output.localized

    @property
    def has_output(self) -> bool:
        return self._output is not None

    def place(self, odometry: Pose2D | None) -> Pose2D | None:
        """Return the pose in the map at an odometry pose; None before the first output."""
        if self._map_from_odometry is None or odometry is None:
            return None
        return self._map_from_odometry.compose(odometry)

    def pose(self, odometry: Pose2D | None, now: float) -> Pose:
        """Return the same as a message; not localized when lost, or without a recent output."""
        place, output = self.place(odometry), self._output
        if place is None or output is None:
            return NOWHERE
        known = output.localized and now - self._at <= STALE
        xx, xy, xt, yy, yt, tt = (min(max(value, -LARGEST), LARGEST) for value in output.covariance)
        score = min(max(output.score, 0.0), 1.0) if now - self._at <= STALE else 0.0
        return Pose(
            x=place.x,
            y=place.y,
            theta=wrap_angle(place.theta),
            covariance=(xx, xy, xt, yy, yt, tt),
            localized=known,
            score=score,
        )
