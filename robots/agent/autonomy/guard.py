"""What runs beside the wheels: it remembers what stands about the robot, and shapes what a driver asks for.

It works at once, on the newest sweep, and needs neither a map nor a mind: help for the driver must not depend on whether the robot knows
where it is.
"""

import math

from robots.agent.autonomy.perception import NO_POINTS
from robots.agent.localization.odometry import Track
from robots.agent.motion import ZERO
from robots.agent.navigation.assist import Assist, Assisted
from robots.agent.navigation.obstacles import ObstacleMemory
from robots.agent.navigation.swept import outside
from robots.agent.world.sensing import Beams, Floats
from robots.api.geometry import Pose2D
from robots.api.messages import AssistLevel, Limits, Point, Velocity

ABOUT = 4.0  # metres about the robot that a mind is told of
TOUCHING = 0.005  # metres: a laser's own error never counts as a contact, the bumper says so
TELLING = 0.5  # seconds for which what the assistance did last is told
QUIET = ("off", "free")
UNASSISTED = Assisted(ZERO, "off")


class Guard:
    """One robot's. `level` is how much the driver is helped, `told` the velocity that the base got last, `steered` the turn in it that was added."""

    def __init__(self, footprint: tuple[Point, ...], limits: Limits) -> None:
        self.level: AssistLevel = "off"
        self.told = ZERO
        self.steered = 0.0
        self.assisted = UNASSISTED
        self._assist = Assist(footprint, limits)
        self._track = Track()
        self._memory = ObstacleMemory()
        self._here: Pose2D | None = None
        self._seen_at = self._shaped_at = -math.inf

    def sense(self, stamp: float, odometry: Pose2D, beams: Beams | None, now: float) -> None:
        """Take a reading: odometry at `stamp` (s, the robot's clock), a sweep when one has come; `now` is monotonic time in seconds."""
        self._here = self._track.add(stamp, odometry)
        if beams is None:
            return
        before = self._memory.seen
        self._memory.update(self._track.at(beams.stamp), beams)
        if self._memory.seen != before:
            self._seen_at = now

    def points(self) -> Floats:
        """Return (n, 2) what stands within `ABOUT` metres, in the robot's frame."""
        return NO_POINTS if self._here is None else self._memory.near(self._here, ABOUT)

    def shape(self, wanted: Velocity, now: float, dock: Pose2D | None = None) -> Assisted:
        """Return what to tell the base instead of what the driver asks for; `dock` is the docked robot's pose, seen from the robot."""
        points, errors = (NO_POINTS, None) if self._here is None else self._memory.about(self._here, self._assist.reach)
        self.assisted = self._assist.shape(wanted, self.told, points, self.level, errors=errors, silence=now - self._seen_at, dock=dock)
        self.told, self._shaped_at = self.assisted.velocity, now
        self.steered = self.assisted.turn
        return self.assisted

    def leave(self, velocity: Velocity) -> None:
        """Take note of a velocity that the base is told without assistance."""
        self.told, self.steered, self.assisted = velocity, 0.0, UNASSISTED

    def clearance(self) -> float | None:
        """Return the distance in metres from the footprint to the nearest thing that was seen lately, None when nothing is near."""
        if self._here is None or self._seen_at == -math.inf:
            return None
        near = self._memory.near(self._here, self._assist.reach)
        return max(float(outside(self._assist.hull, near).min()), TOUCHING) if len(near) else None

    def why(self, now: float) -> tuple[str, Point | None]:
        """Return in one word what the assistance does, "" when nothing, and the point that it minds, in the robot's frame."""
        silent = self.assisted.why in QUIET or now - self._shaped_at > TELLING
        return ("", None) if silent else (self.assisted.why, self.assisted.point)
