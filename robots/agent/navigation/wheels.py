"""Do the wheels turn when they are asked to?"""

from robots.agent.ramp import ZERO
from robots.api.geometry import Pose2D, wrap_angle
from robots.api.messages import Velocity

IN_VAIN = 5.0  # seconds
MOVED, TURNED = 0.01, 0.02  # metres, radians
ASKED = 0.03  # m/s or rad/s that must move a base


class WheelWatch:
    """Tells when a base was asked to move for `IN_VAIN` s without a change of odometry."""

    def __init__(self) -> None:
        self._from: Pose2D | None = None
        self._since = 0.0

    def stuck(self, asked: Velocity, odometry: Pose2D, now: float) -> bool:
        """Take what the base was asked for since the last call, and its odometry."""
        asking = asked != ZERO and max(abs(asked.linear), abs(asked.angular)) >= ASKED
        if not asking or self._from is None or self._moved(odometry):
            self._from, self._since = odometry, now
            return False
        return now - self._since > IN_VAIN

    def _moved(self, odometry: Pose2D) -> bool:
        assert self._from is not None
        return (
            odometry.distance(self._from) > MOVED
            or abs(wrap_angle(odometry.theta - self._from.theta)) > TURNED
        )
