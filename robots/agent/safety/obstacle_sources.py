"""What tells the collision monitor about obstacles: one class for each kind of sensor, chosen by
what the adapter's profile names.

Each keeps its readings in the frame of the odometry, which is smooth, and returns them as points
about the robot. Each counts as lost after a silence of its own, and defines what its loss means.
In directions that no source observes, an assisted driver creeps.

| source | silence | its loss | observes |
|---|---|---|---|
| laser | 0.5 s | the robot stops | everywhere: it remembers what left its view |
| depth points | 0.5 s | the robot stops | the camera's field of view |
| sonar | 1.0 s | the robot stops | its cones |
| bumper | 0.5 s | the robot creeps | nothing: it only detects contact |
"""

import math
from collections import deque
from collections.abc import Sequence
from typing import Literal, Protocol

import numpy as np

from robots.agent.robot_interface import DepthCamera, Profile, RcaState, Sonar
from robots.agent.safety.collision.memory import (
    SAME_BEARING,
    MemorySettings,
    RollingObstacleMap,
)
from robots.agent.safety.collision.odometry import OdometryTrack
from robots.agent.safety.collision.swept import Hull, hull
from robots.api.geometry import Pose2D, wrap_angle
from robots.api.messages import Laser
from robots.world.sensing import Floats, LaserScan, beams_of, points_from_frame, points_in_frame

Loss = Literal["stand", "creep"]
ObstacleReader = Literal["place", "arc", "touch"]
NO_POINTS: Floats = np.zeros((0, 2))


class ObstacleSource(Protocol):
    """A sensor of one robot. Stamps are the robot's Unix time, `now` is monotonic time, both in
    seconds.

    `silence` is how long it may say nothing before it is lost, in seconds; `loss` what the robot
    may do then. Nearer to the footprint than `vague` metres it cannot tell how near something is,
    and a driver who is helped creeps. `tells` says what its points are: where something is, an arc
    somewhere on which something is, or a touch.
    """

    silence: float
    loss: Loss
    vague: float
    tells: ObstacleReader

    def sense(self, reading: RcaState, track: OdometryTrack, now: float) -> None:
        """Take what is new in a reading; `track` tells where the robot was at its stamps."""

    def last_received_at(self) -> float:
        """Return when it said something last; of several sensors, the one that has been silent for
        longest.
        """

    def about(self, here: Pose2D, radius: float) -> tuple[Floats, Floats]:
        """Return (n, 2) points within `radius` metres in the robot's frame at `here`, and (n,) by
        how much each may be off, in metres.
        """

    def seen(self, here: Pose2D, radius: float) -> Floats:
        """Return the same points without those that are only guessed at, behind the edges of
        others.
        """

    def beside(self, bearings: Floats) -> Floats:
        """Return (n,) by how much directions from the robot (n,) lie outside of what it observes:
        0 inside, both in radians.
        """


class LaserSource:
    """A planar laser, with its memory (collision/memory.py)."""

    silence = 0.5
    loss: Loss = "stand"
    vague = 0.0
    tells: ObstacleReader = "place"

    def __init__(self, laser: Laser, settings: MemorySettings | None = None) -> None:
        self._last_received_at = -math.inf
        self._laser = laser
        self._memory = RollingObstacleMap(settings)

    def sense(self, reading: RcaState, track: OdometryTrack, now: float) -> None:
        """Take the scan of a reading, when it has one."""
        if reading.scan is not None:
            self.look(beams_of(reading.scan, self._laser), track, now)

    def look(self, beams: LaserScan, track: OdometryTrack, now: float) -> None:
        """Take a sweep; one that sees nothing at all is that of a broken laser, and no sign of
        life.
        """
        before = self._memory.seen
        self._memory.update(track.at(beams.stamp), beams)
        if self._memory.seen != before:
            self._last_received_at = now

    def last_received_at(self) -> float:
        """Return when a sweep came last."""
        return self._last_received_at

    def about(self, here: Pose2D, radius: float) -> tuple[Floats, Floats]:
        """Return what was seen lately, and what edges hide."""
        return self._memory.about(here, radius)

    def seen(self, here: Pose2D, radius: float) -> Floats:
        """Return what was seen lately."""
        return self._memory.near(here, radius)

    def beside(self, bearings: Floats) -> Floats:
        """Return zeros: the laser has been turned there, or its memory reaches there."""
        return np.zeros(len(bearings))


class DepthSource(LaserSource):
    """A depth camera: its points are taken as the sweep of a laser with its field of view, the
    nearest in each direction.
    """

    def __init__(self, camera: DepthCamera, beams: int = 120) -> None:
        super().__init__(
            Laser(x=camera.x, y=camera.y, theta=camera.theta), MemorySettings(sees=0.0, blind=0.0)
        )
        self._camera, self._beams = camera, beams
        self._mount = Pose2D(camera.x, camera.y, camera.theta)

    def sense(self, reading: RcaState, track: OdometryTrack, now: float) -> None:
        """Take the points of a reading. That none came is no fault: the floor is free."""
        seen, camera = reading.points, self._camera
        if seen is None:
            return
        step = camera.width / (self._beams - 1)
        local = points_in_frame(self._mount, seen.points)
        beam = np.rint((np.arctan2(local[:, 1], local[:, 0]) + camera.width / 2.0) / step).astype(
            np.intp
        )
        distance = np.hypot(local[:, 0], local[:, 1])
        inside = (beam >= 0) & (beam < self._beams) & (distance < camera.farthest)
        ranges = np.full(self._beams, np.inf)
        np.minimum.at(ranges, beam[inside], distance[inside])
        self.look(
            LaserScan(seen.stamp, -camera.width / 2.0, step, camera.farthest, ranges, self._mount),
            track,
            now,
        )

    def beside(self, bearings: Floats) -> Floats:
        """Return how far directions are from the camera's field of view."""
        return _beside_cone(bearings, self._camera)


class SonarSource:
    """Sensors with cones. An echo comes from somewhere on an arc, and all of the arc is kept where
    it lay.

    A point is taken away when a cone looks through it twice, and forgotten after so much way.
    Twice, because an echo is easily lost once: crosstalk, or a wall that is met at a slant. It has
    to be kept, because a ring is blind between two cones close to the robot.
    """

    silence = 1.0
    loss: Loss = "stand"
    vague = 0.1
    tells: ObstacleReader = "arc"
    SPACING = 0.05  # metres between two points of an arc
    OFF = 0.02  # metres that an echo may be off
    MARGIN = 0.06  # metres by which a point must be nearer than an echo to be looked through
    DOUBTS = 2
    # metres driven for which a point is kept, and how many of them a radian of turning counts as
    WAY, TURN = 2.0, 0.3

    def __init__(self, sonars: Sequence[Sonar]) -> None:
        self._sonars = tuple(sonars)
        self._heard = [-math.inf] * len(self._sonars)
        # x, y, the way driven when it was heard, how many cones have looked through it since
        self._points: Floats = np.zeros((0, 4))
        self._way = 0.0
        self._was: Pose2D | None = None

    def sense(self, reading: RcaState, track: OdometryTrack, now: float) -> None:
        """Take echoes, and that there were none."""
        for echo in reading.sonar:
            if 0 <= echo.sonar < len(self._sonars):
                self._heard[echo.sonar] = now
                self._take(self._sonars[echo.sonar], echo.distance, track.at(echo.stamp))

    def last_received_at(self) -> float:
        """Return when the sensor that has been silent for longest was heard."""
        return min(self._heard)

    def about(self, here: Pose2D, radius: float) -> tuple[Floats, Floats]:
        """Return the arcs."""
        near = self.seen(here, radius)
        return near, np.full(len(near), self.OFF)

    def seen(self, here: Pose2D, radius: float) -> Floats:
        """Return the arcs."""
        return within(self._points, here, radius)

    def beside(self, bearings: Floats) -> Floats:
        """Return how far directions are from the nearest cone."""
        nearest: Floats = np.min([_beside_cone(bearings, each) for each in self._sonars], axis=0)
        return nearest

    def _take(self, sonar: Sonar, distance: float | None, robot: Pose2D) -> None:
        self._travel(robot)
        reach = sonar.farthest if distance is None else min(distance, sonar.farthest)
        eye = robot.compose(Pose2D(sonar.x, sonar.y, sonar.theta))
        local = points_in_frame(eye, self._points)
        apart = np.hypot(local[:, 0], local[:, 1])
        inside = np.abs(np.arctan2(local[:, 1], local[:, 0])) <= sonar.width / 2.0 + SAME_BEARING
        self._points[inside & (apart < reach - self.MARGIN), 3] += 1.0
        again = inside & (np.abs(apart - reach) <= self.MARGIN)
        old = self._points[:, 2] < self._way - self.WAY
        kept = self._points[~(again | old | (self._points[:, 3] >= self.DOUBTS))]
        arc = self._arc(sonar, reach)
        new = np.zeros((len(arc), 4))
        new[:, :2], new[:, 2] = points_from_frame(eye, arc), self._way
        self._points = np.concatenate([kept, new])

    def _travel(self, robot: Pose2D) -> None:
        if self._was is not None:
            self._way += self._was.distance(robot) + self.TURN * abs(
                wrap_angle(robot.theta - self._was.theta)
            )
        self._was = robot

    def _arc(self, sonar: Sonar, reach: float) -> Floats:
        """Return (n, 2) where an echo may come from, seen from the sensor; what is too near to be
        measured is taken to be halfway to that.
        """
        if reach >= sonar.farthest:
            return NO_POINTS
        distance = sonar.nearest / 2.0 if reach <= sonar.nearest else reach
        angles = np.linspace(
            -sonar.width / 2.0, sonar.width / 2.0, 2 + int(distance * sonar.width / self.SPACING)
        )
        return np.column_stack([distance * np.cos(angles), distance * np.sin(angles)])


class BumperSource:
    """A bumper that knows directions: what was touched stands there, at the edge of the footprint,
    for `KEPT` seconds after.
    """

    silence = 0.5
    loss: Loss = "creep"
    vague = 0.05
    tells: ObstacleReader = "touch"
    KEPT = 20.0  # s
    FELT = np.linspace(-0.2, 0.2, 5)  # rad about the direction of a contact that count as touched
    BEYOND = 0.005  # metres

    def __init__(self, shape: Hull) -> None:
        self._shape = shape
        self._last_received_at = self._now = -math.inf
        self._felt: deque[tuple[float, Floats]] = deque(maxlen=64)
        self._pressed: tuple[float, ...] = ()

    def sense(self, reading: RcaState, track: OdometryTrack, now: float) -> None:
        """Take which directions are pressed: each contact where it begins, and where it ends."""
        self._now = now
        if reading.bumper is None:
            return
        self._last_received_at = now
        before, self._pressed = self._pressed, reading.bumper
        if reading.bumper != before:
            points = [self._edge(bearing) for bearing in (*before, *reading.bumper)]
            self._felt.append(
                (
                    now,
                    points_from_frame(
                        track.at(reading.stamp), np.concatenate([NO_POINTS, *points])
                    ),
                )
            )

    def last_received_at(self) -> float:
        """Return when it was last known what is touched."""
        return self._last_received_at

    def about(self, here: Pose2D, radius: float) -> tuple[Floats, Floats]:
        """Return what was touched lately."""
        near = self.seen(here, radius)
        return near, np.zeros(len(near))

    def seen(self, here: Pose2D, radius: float) -> Floats:
        """Return the same."""
        while self._felt and self._now - self._felt[0][0] > self.KEPT:
            self._felt.popleft()
        return within(
            np.concatenate([NO_POINTS, *(points for _, points in self._felt)]), here, radius
        )

    def beside(self, bearings: Floats) -> Floats:
        """Return infinity: a bumper observes nothing before it is touched."""
        return np.full(len(bearings), np.inf)

    def _edge(self, bearing: float) -> Floats:
        """Return (n, 2) points just outside the footprint about a direction."""
        ways = np.column_stack([np.cos(bearing + self.FELT), np.sin(bearing + self.FELT)])
        towards = ways @ self._shape.normals.T
        with np.errstate(divide="ignore"):
            reach = np.where(towards > 0.0, self._shape.offsets / towards, np.inf).min(axis=1)
        points: Floats = ways * (reach + self.BEYOND)[:, None]
        return points


def within(points: Floats, here: Pose2D, radius: float) -> Floats:
    """Return (n, 2) those of points (m, 2 or more) that are within `radius` metres of a robot at
    `here`, in its frame.
    """
    local = points_in_frame(here, points)
    near: Floats = local[np.hypot(local[:, 0], local[:, 1]) <= radius]
    return near


def _beside_cone(bearings: Floats, cone: Sonar | DepthCamera) -> Floats:
    off_axis = np.abs(np.remainder(bearings - cone.theta + math.pi, 2.0 * math.pi) - math.pi)
    beside: Floats = np.maximum(off_axis - cone.width / 2.0, 0.0)
    return beside


def sources_of(profile: Profile) -> Sequence[ObstacleSource]:
    """Return what tells of obstacles about a robot, nothing for one that is blind.

    Raises:
        ValueError: the footprint is none.
    """
    found: list[ObstacleSource] = []
    if profile.laser is not None:
        found.append(LaserSource(profile.laser))
    if profile.depth is not None:
        found.append(DepthSource(profile.depth))
    if profile.sonars:
        found.append(SonarSource(profile.sonars))
    if profile.bumper:
        found.append(BumperSource(hull(profile.footprint)))
    return found
