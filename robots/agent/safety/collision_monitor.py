"""The collision monitor: a stage of the safety kernel's tick. It keeps the obstacles about the
robot and shapes the driver's velocity.

Pure: readings and times in, velocities out. It uses the newest readings directly and needs neither
a map nor another process, so that assistance does not depend on localization.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from robots.agent.ramp import ZERO
from robots.agent.robot_interface import Profile, RcaState
from robots.agent.safety.collision.assist import Assisted, DriverAssistance
from robots.agent.safety.collision.odometry import OdometryTrack
from robots.agent.safety.collision.swept import outside
from robots.agent.safety.obstacle_sources import NO_POINTS, ObstacleSource, sources_of
from robots.api.floorplan import ChargingDock as Station
from robots.api.geometry import Pose2D
from robots.api.messages import AssistLevel, Limits, Point, Pose, Velocity
from robots.world.sensing import CENTRE, Floats


@dataclass(frozen=True)
class MonitorParams:
    """What the collision monitor reports, and how fast a robot may move unobserved."""

    about: float = 4.0  # m about the robot that navigation is told of
    touching: float = 0.005  # m: a sensor's own error never counts as a contact, the bumper says so
    # m/s of any corner in a direction that no sensor observes: too slow to do harm
    creep: float = 0.1
    # rad beside a sensor's view: up to `observed_beside` a direction counts as observed, for a
    # robot that drives a little askew; from `unobserved_beside` on the robot creeps
    observed_beside: float = 0.2
    unobserved_beside: float = 0.3
    telling: float = 0.5  # s for which what the assistance did last is told
    # m beyond the footprint, where a cone of 30° is narrower than most robots
    near_arc: float = 0.3
    longest_step: float = 0.5  # s for which a velocity says where the robot went


MONITOR = MonitorParams()
DIRECTIONS = 720  # of a table by direction
QUIET = ("off", "free")
UNASSISTED = Assisted(ZERO, "off")


class CollisionMonitor:
    """One robot's. `dock` is the docked robot's pose seen from the robot, None when unknown: its
    station may be touched.
    """

    def __init__(
        self, footprint: tuple[Point, ...], limits: Limits, sources: Sequence[ObstacleSource]
    ) -> None:
        """Take the footprint (convex, about the robot's centre), the base's own limits, and what
        tells of obstacles.

        Raises:
            ValueError: not such a footprint.
        """
        self.dock: Pose2D | None = None
        self.track = OdometryTrack()
        self._assist = DriverAssistance(footprint, limits)
        self._sources = tuple(sources)
        self._corners = np.array(footprint, dtype=np.float64)
        self._fastest = fastest_by_direction(self._sources)
        self._here: Pose2D | None = None
        self._reckoning, self._reckoned_at = CENTRE, math.inf
        self._shaped_at = -math.inf
        self._last = UNASSISTED

    def sense(self, reading: RcaState, now: float) -> None:
        """Take a reading; `now` is monotonic time in seconds."""
        self.moved(
            reading.stamp, self._reckoned(reading) if reading.odometry is None else reading.odometry
        )
        for source in self._sources:
            source.sense(reading, self.track, now)

    def moved(self, stamp: float, odometry: Pose2D) -> None:
        """Take dead reckoning at `stamp`, the robot's Unix time in seconds."""
        self._here = self.track.add(stamp, odometry)

    def shape(self, wanted: Velocity, told: Velocity, level: AssistLevel, now: float) -> Assisted:
        """Return what to tell the base instead of what the driver asks for.

        Args:
            wanted: what the limits let pass, as the driver's own ramp has it now.
            told: what the base was last told.
            level: how much the driver is helped.
            now: monotonic time in seconds.
        """
        points, errors = self._about(self._assist.reach)
        lost = {
            source.loss
            for source in self._sources
            if not now - source.last_received_at() <= source.silence
        }
        silence = math.inf if "stand" in lost else 0.0
        everywhere = "creep" in lost or self._is_vague()
        slower = self._crept(wanted, everywhere=everywhere)
        found = self._assist.shape(
            slower, told, points, level, errors=errors, silence=silence, dock=self.dock
        )
        # steering may have added a turn
        found = replace(found, velocity=self._crept(found.velocity, everywhere=everywhere))
        self._last = (
            replace(found, why="slow") if slower != wanted and found.why in QUIET else found
        )
        self._shaped_at = now
        return self._last

    def _crept(self, wanted: Velocity, *, everywhere: bool) -> Velocity:
        """Return a velocity on the same arc at which no corner moves faster than a creep in a
        direction that no sensor observes; in any direction with `everywhere`.
        """
        # (x, y) of each corner, in the robot's frame: velocity + angular velocity x arm
        x = wanted.linear - wanted.angular * self._corners[:, 1]
        y = wanted.angular * self._corners[:, 0]
        fastest = MONITOR.creep if everywhere else self._fastest[_index_of(np.arctan2(y, x))]
        share = float(np.min(fastest / np.maximum(np.hypot(x, y), 1e-9)))
        if share >= 1.0:
            return wanted
        return Velocity(linear=wanted.linear * share, angular=wanted.angular * share)

    def _is_vague(self) -> bool:
        """Tell whether something is so near that nobody knows how near."""
        if self._here is None:
            return False
        reach = self._assist.hull.radius
        near = [
            (source.vague, source.seen(self._here, reach + source.vague))
            for source in self._sources
            if source.vague > 0.0
        ]
        return any(
            len(points) and float(outside(self._assist.hull, points).min()) < vague
            for vague, points in near
        )

    def _reckoned(self, reading: RcaState) -> Pose2D:
        """Return dead reckoning for a robot that gives none: by the velocity that was measured."""
        before, self._reckoned_at = self._reckoned_at, reading.stamp
        seconds = min(max(reading.stamp - before, 0.0), MONITOR.longest_step)
        turn = reading.velocity.angular * seconds
        way = reading.velocity.linear * seconds
        self._reckoning = self._reckoning.compose(
            Pose2D(way * math.cos(turn / 2.0), way * math.sin(turn / 2.0), turn)
        )
        return self._reckoning

    def points(self) -> Floats:
        """Return (n, 2) what was seen about the robot lately, in the robot's frame.

        Navigation looks for a path between them. An arc of a sonar is as wide as it is far away,
        and a robot that sees places would take doorways for closed: beside another sensor only near
        arcs count, such as that of a glass door which a laser looks through.
        """
        if not any(source.tells == "place" for source in self._sources):
            return self._seen(MONITOR.about, self._sources)
        exact = [source for source in self._sources if source.tells != "arc"]
        arcs = [source for source in self._sources if source.tells == "arc"]
        return np.concatenate(
            [
                self._seen(MONITOR.about, exact),
                self._seen(self._assist.hull.radius + MONITOR.near_arc, arcs),
            ]
        )

    def clearance(self) -> float | None:
        """Return the distance in metres from the footprint to the nearest thing that was seen
        lately, None when nothing is near.
        """
        near = self._seen(self._assist.reach, self._sources)
        return (
            max(float(outside(self._assist.hull, near).min()), MONITOR.touching)
            if len(near)
            else None
        )

    def why(self, now: float) -> tuple[str, Point | None]:
        """Return in one word what the assistance does, "" when nothing, and the point that it
        minds, in the robot's frame.
        """
        silent = self._last.why in QUIET or now - self._shaped_at > MONITOR.telling
        return ("", None) if silent else (self._last.why, self._last.point)

    def _about(self, radius: float) -> tuple[Floats, Floats]:
        if self._here is None:
            return NO_POINTS, np.zeros(0)
        found = [source.about(self._here, radius) for source in self._sources]
        return (
            found[0]
            if len(found) == 1
            else (
                np.concatenate([points for points, _ in found]),
                np.concatenate([off for _, off in found]),
            )
        )

    def _seen(self, radius: float, sources: Sequence[ObstacleSource]) -> Floats:
        if self._here is None:
            return NO_POINTS
        return np.concatenate([NO_POINTS, *(source.seen(self._here, radius) for source in sources)])


def fastest_by_direction(sources: Sequence[ObstacleSource]) -> Floats:
    """Return (DIRECTIONS,) the largest speed in m/s of a corner in each direction.

    It falls continuously from infinity to a creep beside a sensor's view. A step there would make
    a driver's velocity jump up and down while it is ramped along the edge of a view.
    """
    bearings: Floats = np.linspace(0.0, 2.0 * math.pi, DIRECTIONS, endpoint=False)
    beside = np.min([source.beside(bearings) for source in sources], axis=0)
    margin = MONITOR.unobserved_beside - MONITOR.observed_beside
    unobserved = np.clip((beside - MONITOR.observed_beside) / margin, 0.0, 1.0)
    # the worst of three neighbours, so that no direction between two of them may be faster
    unobserved = np.max([np.roll(unobserved, by) for by in (-1, 0, 1)], axis=0)
    with np.errstate(divide="ignore"):
        fastest: Floats = MONITOR.creep / unobserved
    return fastest


def _index_of(bearings: Floats) -> npt.NDArray[np.intp]:
    return np.rint(bearings * (DIRECTIONS / (2.0 * math.pi))).astype(np.intp) % DIRECTIONS


def monitor_of(profile: Profile) -> CollisionMonitor | None:
    """Return the collision monitor of a robot, None for one without a sensor for obstacles."""
    sources = sources_of(profile)
    return CollisionMonitor(profile.footprint, profile.limits, sources) if sources else None


def seen_from(pose: Pose, dock: Station | None) -> Pose2D | None:
    """Return the docked robot's pose seen from a robot at `pose` in the map, None when either is
    unknown.
    """
    if dock is None or not pose.localized:
        return None
    return Pose2D(pose.x, pose.y, pose.theta).inverse().compose(Pose2D(dock.x, dock.y, dock.theta))
