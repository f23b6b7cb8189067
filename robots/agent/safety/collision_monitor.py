"""The collision monitor, a stage of the safety kernel's tick: it keeps the obstacles around the
robot and shapes the driver's velocity. Pure.

It uses the newest readings directly and needs neither a map nor another process, so that assistance
does not depend on localization.
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from robots.agent.ramp import ZERO
from robots.agent.robot_interface import Profile, RcaState
from robots.agent.safety.collision.assist import Assisted, DriverAssistance
from robots.agent.safety.collision.odometry import Delay, OdometryTrack, carried
from robots.agent.safety.collision.swept import outside
from robots.agent.safety.obstacle_sources import NO_POINTS, ObstacleSource, sources_of
from robots.api.floorplan import ChargingDock as Station
from robots.api.geometry import Pose2D
from robots.api.messages import AssistLevel, Limits, Point, Pose, Velocity
from robots.world.sensing import CENTRE, Floats


@dataclass(frozen=True)
class MonitorParams:
    about: float = 4.0  # m around the robot in which navigation gets obstacles
    touching: float = 0.005  # m, the least clearance: only a bumper reports a contact
    # m/s of any corner in a direction that no sensor observes: too slow to do harm
    creep: float = 0.1
    # rad beside a sensor's view: up to `observed_beside` a direction counts as observed, for a
    # robot that drives a little askew; from `unobserved_beside` on the robot creeps
    observed_beside: float = 0.2
    unobserved_beside: float = 0.3
    reported_for: float = 0.5  # s for which the last assistance is reported
    # m beyond the footprint, where a cone of 30° is narrower than most robots
    near_arc: float = 0.3
    longest_step: float = 0.5  # s for which a velocity is integrated


MONITOR = MonitorParams()
DIRECTIONS = 720  # of a table by direction
QUIET = ("off", "free")
UNASSISTED = Assisted(ZERO, "off")


class CollisionMonitor:
    """One robot's monitor. `dock` is the docked robot's pose in the robot's frame, None when
    unknown: its station may be touched.
    """

    def __init__(
        self, footprint: tuple[Point, ...], limits: Limits, sources: Sequence[ObstacleSource]
    ) -> None:
        """Take the footprint, the base's own limits and the sensors. Raises ValueError unless the
        footprint is convex and around the robot's centre.
        """
        self.dock: Pose2D | None = None
        self.track = OdometryTrack()
        self._assist = DriverAssistance(footprint, limits)
        self._sources = tuple(sources)
        self._corners = np.array(footprint, dtype=np.float64)
        self._fastest = fastest_by_direction(self._sources)
        self._here: Pose2D | None = None
        self._measured_at, self._delay = math.inf, Delay()
        self._sent: deque[tuple[float, Velocity]] = deque(maxlen=64)  # (until when, what)
        self._reckoning, self._reckoned_at = CENTRE, math.inf
        self._shaped_at = -math.inf
        self._last = UNASSISTED

    def sense(self, reading: RcaState, now: float) -> None:
        """Take a reading; `now` is monotonic time in seconds."""
        delay = 0.0
        if reading.is_measured or self._here is None:
            stamp = reading.stamp if reading.odometry_stamp is None else reading.odometry_stamp
            delay = self._delay.of(stamp, now)
            self._measured_at = now - delay
            self.moved(
                stamp, self._reckoned(reading) if reading.odometry is None else reading.odometry
            )
        for source in self._sources:
            source.sense(reading, self.track, now - delay)

    def moved(self, stamp: float, odometry: Pose2D) -> None:
        """Take dead reckoning at `stamp`, the robot's Unix time in seconds."""
        self._here = self.track.add(stamp, odometry)

    def shape(
        self, wanted: Velocity, last_sent: Velocity, level: AssistLevel, now: float
    ) -> Assisted:
        """Return what to send to the base instead of `wanted`, which is within the limits and on
        the driver's ramp. `last_sent` is what the base was last sent; `now` is monotonic time.
        """
        points, errors = self._about(self._expected(last_sent, now), self._assist.reach)
        lost = {
            source.loss
            for source in self._sources
            if not now - source.last_received_at() <= source.silence
        }
        silence = math.inf if "stand" in lost else 0.0
        everywhere = "creep" in lost or self._is_vague()
        slower = self._crept(wanted, everywhere=everywhere)
        found = self._assist.shape(
            slower, last_sent, points, level, errors=errors, silence=silence, dock=self.dock
        )
        # steering may have added a turn
        found = replace(found, velocity=self._crept(found.velocity, everywhere=everywhere))
        if slower != wanted and found.why in QUIET:
            found = replace(found, why="slow")
        self._last, self._shaped_at = found, now
        return found

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
        """Tell whether a point is so near that its sensor cannot tell how near."""
        if self._here is None:
            return False
        reach = self._assist.hull.radius
        for source in self._sources:
            if source.vague > 0.0:
                points = source.seen(self._here, reach + source.vague)
                if (outside(self._assist.hull, points) < source.vague).any():
                    return True
        return False

    def _reckoned(self, reading: RcaState) -> Pose2D:
        """Return dead reckoning from measured velocities, for a robot without odometry."""
        before, self._reckoned_at = self._reckoned_at, reading.stamp
        seconds = min(max(reading.stamp - before, 0.0), MONITOR.longest_step)
        self._reckoning = carried(self._reckoning, reading.velocity, seconds)
        return self._reckoning

    def points(self) -> Floats:
        """Return (n, 2) recent obstacles around the robot, in its frame, for navigation.

        An arc of a sonar is as wide as it is far away and would close doorways: beside a sensor
        that sees places only near arcs count, such as that of a glass door which a laser looks
        through.
        """
        if not any(source.tells == "place" for source in self._sources):
            return self._seen(MONITOR.about, self._sources)
        exact = [source for source in self._sources if source.tells != "arc"]
        arcs = [source for source in self._sources if source.tells == "arc"]
        near = self._assist.hull.radius + MONITOR.near_arc
        return np.concatenate([self._seen(MONITOR.about, exact), self._seen(near, arcs)])

    def clearance(self) -> float | None:
        """Return the distance in metres from the footprint to the nearest obstacle, None without
        one.
        """
        near = self._seen(self._assist.reach, self._sources)
        if not len(near):
            return None
        return max(float(outside(self._assist.hull, near).min()), MONITOR.touching)

    def why(self, now: float) -> tuple[str, Point | None]:
        """Return what the assistance does in one word ("" for nothing), and its obstacle in the
        robot's frame.
        """
        silent = self._last.why in QUIET or now - self._shaped_at > MONITOR.reported_for
        return ("", None) if silent else (self._last.why, self._last.point)

    def _expected(self, sent: Velocity, now: float) -> Pose2D | None:
        """Return where the robot is by now, if it has obeyed since the newest odometry."""
        self._sent.append((now, sent))
        if self._here is None:
            return None
        pose, since = self._here, max(self._measured_at, now - MONITOR.longest_step)
        for until, velocity in self._sent:
            if until > since:
                pose, since = carried(pose, velocity, until - since), until
        return pose

    def _about(self, here: Pose2D | None, radius: float) -> tuple[Floats, Floats]:
        if here is None:
            return NO_POINTS, np.zeros(0)
        found = [source.about(here, radius) for source in self._sources]
        if len(found) == 1:
            return found[0]
        points, errors = zip(*found, strict=True)
        return np.concatenate(points), np.concatenate(errors)

    def _seen(self, radius: float, sources: Sequence[ObstacleSource]) -> Floats:
        if self._here is None:
            return NO_POINTS
        return np.concatenate([NO_POINTS, *(source.seen(self._here, radius) for source in sources)])


def fastest_by_direction(sources: Sequence[ObstacleSource]) -> Floats:
    """Return (DIRECTIONS,) the largest speed in m/s of a corner in each direction.

    It falls continuously from infinity to a creep beside a sensor's view; a step would make a
    velocity jump while it is ramped along the edge of a view.
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
    """Return the collision monitor of a robot, None for one without sensors for obstacles."""
    sources = sources_of(profile)
    return CollisionMonitor(profile.footprint, profile.limits, sources) if sources else None


def seen_from(pose: Pose, dock: Station | None) -> Pose2D | None:
    """Return the docked pose in the frame of a robot at `pose` on the map, None when unknown."""
    if dock is None or not pose.localized:
        return None
    return Pose2D(pose.x, pose.y, pose.theta).inverse().compose(Pose2D(dock.x, dock.y, dock.theta))
