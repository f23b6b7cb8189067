"""Sensors of obstacles for the collision monitor: one class a kind, chosen by the adapter's
profile.

Each keeps its readings in the smooth frame of the odometry, and returns them as points around the
robot. Each counts as lost after its own silence, and defines what its loss means. In directions
that no source observes, an assisted driver creeps.

| source | silence | its loss | observes |
|---|---|---|---|
| laser | 0.5 s | the robot stops | everywhere: it remembers what left its view |
| depth points | 0.5 s | the robot stops | the camera's field of view |
| sonar | 1.0 s | the robot stops | its cones |
| bumper | 0.5 s | the robot creeps | nothing: it only detects contact |
"""

import math
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Sequence
from typing import Literal

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
PointMeaning = Literal["place", "arc", "touch"]
NO_POINTS: Floats = np.zeros((0, 2))


class ObstacleSource(ABC):
    """A sensor of one robot. Stamps are the robot's Unix time, `now` is monotonic, both in seconds.

    After `silence` seconds it is lost, and `loss` is what the robot does then. Nearer to the
    footprint than `vague` metres it cannot measure distance, and an assisted driver creeps. `tells`
    is what a point means: an obstacle's place, an arc somewhere on which it is, or a touch.
    """

    silence = 0.5
    loss: Loss = "stand"
    vague = 0.0
    tells: PointMeaning
    error = 0.0  # metres that a point may be off
    _last_received_at = -math.inf

    @abstractmethod
    def sense(self, reading: RcaState, track: OdometryTrack, now: float) -> None:
        """Take the new data of a reading; `track` has the robot's pose at its stamps."""

    def last_received_at(self) -> float:
        """Return the time of its last data; of several sensors, of the one silent for longest."""
        return self._last_received_at

    def about(self, here: Pose2D, radius: float) -> tuple[Floats, Floats]:
        """Return (n, 2) points within `radius` metres in the robot's frame at `here`, and (n,)
        their possible errors in metres.
        """
        near = self.seen(here, radius)
        return near, np.full(len(near), self.error)

    @abstractmethod
    def seen(self, here: Pose2D, radius: float) -> Floats:
        """Return the same points without those guessed behind the edges of others."""

    @abstractmethod
    def beside(self, bearings: Floats) -> Floats:
        """Return (n,) angles of directions (n,) outside of what it observes, 0 inside; radians."""


class LaserSource(ObstacleSource):
    """A planar laser, with its memory (collision/memory.py)."""

    tells = "place"

    def __init__(self, laser: Laser, settings: MemorySettings | None = None) -> None:
        self._laser = laser
        self._memory = RollingObstacleMap(settings)

    def sense(self, reading: RcaState, track: OdometryTrack, now: float) -> None:
        if reading.scan is not None:
            self.look(beams_of(reading.scan, self._laser), track, now)

    def look(self, beams: LaserScan, track: OdometryTrack, now: float) -> None:
        """Take a scan; one without any echo is of a broken laser, and does not count."""
        before = self._memory.seen
        self._memory.update(track.at(beams.stamp), beams)
        if self._memory.seen != before:
            self._last_received_at = now

    def about(self, here: Pose2D, radius: float) -> tuple[Floats, Floats]:
        return self._memory.about(here, radius)

    def seen(self, here: Pose2D, radius: float) -> Floats:
        return self._memory.near(here, radius)

    def beside(self, bearings: Floats) -> Floats:
        """Return zeros: the laser has seen these directions, or its memory has."""
        return np.zeros(len(bearings))


class DepthSource(LaserSource):
    """A depth camera. Its points are treated as a laser scan of its field of view: the nearest in
    each direction.
    """

    def __init__(self, camera: DepthCamera, beams: int = 120) -> None:
        mount = Laser(x=camera.x, y=camera.y, theta=camera.theta)
        super().__init__(mount, MemorySettings(sees=0.0, blind=0.0))
        self._camera, self._beams = camera, beams
        self._mount = Pose2D(camera.x, camera.y, camera.theta)

    def sense(self, reading: RcaState, track: OdometryTrack, now: float) -> None:
        """Take the points of a reading. No points at all means a free floor."""
        seen, camera = reading.points, self._camera
        if seen is None:
            return
        first, step = -camera.width / 2.0, camera.width / (self._beams - 1)
        local = points_in_frame(self._mount, seen.points)
        beam = np.rint((np.arctan2(local[:, 1], local[:, 0]) - first) / step).astype(np.intp)
        distance = np.hypot(local[:, 0], local[:, 1])
        inside = (beam >= 0) & (beam < self._beams) & (distance < camera.farthest)
        ranges = np.full(self._beams, np.inf)
        np.minimum.at(ranges, beam[inside], distance[inside])
        scan = LaserScan(seen.stamp, first, step, camera.farthest, ranges, self._mount)
        self.look(scan, track, now)

    def beside(self, bearings: Floats) -> Floats:
        return _beside_cone(bearings, self._camera)


class SonarSource(ObstacleSource):
    """Sensors with cones. An echo comes from somewhere on an arc, and all of the arc is kept in
    place, because a ring is blind between two cones close to the robot.

    A point is removed when a cone looks through it twice, and forgotten after some distance. Twice,
    because one echo is easily lost: crosstalk, or a wall that is met at a slant.
    """

    silence = 1.0
    vague = 0.1
    tells = "arc"
    error = 0.02
    SPACING = 0.05  # metres between two points of an arc
    MARGIN = 0.06  # metres by which a point must be nearer than an echo to be looked through
    DOUBTS = 2
    DISTANCE = 2.0  # metres driven for which a point is kept
    TURN = 0.3  # metres that a radian of turning counts as

    def __init__(self, sonars: Sequence[Sonar]) -> None:
        self._sonars = tuple(sonars)
        self._received_at = [-math.inf] * len(self._sonars)
        # x, y, the distance driven at its echo, how many cones have looked through it since
        self._points: Floats = np.zeros((0, 4))
        self._distance = 0.0
        self._last_pose: Pose2D | None = None

    def sense(self, reading: RcaState, track: OdometryTrack, now: float) -> None:
        """Take echoes, and missing echoes."""
        for echo in reading.sonar:
            if 0 <= echo.sonar < len(self._sonars):
                self._received_at[echo.sonar] = now
                self._take(self._sonars[echo.sonar], echo.distance, track.at(echo.stamp))

    def last_received_at(self) -> float:
        return min(self._received_at)

    def seen(self, here: Pose2D, radius: float) -> Floats:
        return within(self._points, here, radius)

    def beside(self, bearings: Floats) -> Floats:
        nearest: Floats = np.min([_beside_cone(bearings, each) for each in self._sonars], axis=0)
        return nearest

    def _take(self, sonar: Sonar, distance: float | None, robot: Pose2D) -> None:
        """Add the arc of an echo, or none without an echo (`distance` None), and drop points that
        it measures again, that two cones have looked through, or that are out of date.
        """
        self._travel(robot)
        reach = sonar.farthest if distance is None else min(distance, sonar.farthest)
        eye = robot.compose(Pose2D(sonar.x, sonar.y, sonar.theta))
        local = points_in_frame(eye, self._points)
        apart = np.hypot(local[:, 0], local[:, 1])
        inside = np.abs(np.arctan2(local[:, 1], local[:, 0])) <= sonar.width / 2.0 + SAME_BEARING
        self._points[inside & (apart < reach - self.MARGIN), 3] += 1.0
        again = inside & (np.abs(apart - reach) <= self.MARGIN)
        old = self._points[:, 2] < self._distance - self.DISTANCE
        kept = self._points[~(again | old | (self._points[:, 3] >= self.DOUBTS))]
        arc = self._arc(sonar, reach)
        new = np.zeros((len(arc), 4))
        new[:, :2], new[:, 2] = points_from_frame(eye, arc), self._distance
        self._points = np.concatenate([kept, new])

    def _travel(self, robot: Pose2D) -> None:
        last, self._last_pose = self._last_pose or robot, robot
        turn = abs(wrap_angle(robot.theta - last.theta))
        self._distance += last.distance(robot) + self.TURN * turn

    def _arc(self, sonar: Sonar, reach: float) -> Floats:
        """Return (n, 2) where an echo may come from, in the sensor's frame; an obstacle too near to
        be measured is taken to be at half the nearest distance.
        """
        if reach >= sonar.farthest:
            return NO_POINTS
        distance = sonar.nearest / 2.0 if reach <= sonar.nearest else reach
        count = 2 + int(distance * sonar.width / self.SPACING)
        angles = np.linspace(-sonar.width / 2.0, sonar.width / 2.0, count)
        return np.column_stack([distance * np.cos(angles), distance * np.sin(angles)])


class BumperSource(ObstacleSource):
    """A bumper with directions: an obstacle is kept at the touched edge for `KEPT` seconds."""

    loss = "creep"
    vague = 0.05
    tells = "touch"
    KEPT = 20.0  # s
    FELT = np.linspace(-0.2, 0.2, 5)  # rad about the direction of a contact that count as touched
    BEYOND = 0.005  # metres

    def __init__(self, shape: Hull) -> None:
        self._shape = shape
        self._now = -math.inf
        self._felt: deque[tuple[float, Floats]] = deque(maxlen=64)
        self._pressed: tuple[float, ...] = ()

    def sense(self, reading: RcaState, track: OdometryTrack, now: float) -> None:
        """Take the pressed directions: each contact where it starts, and where it ends."""
        self._now = now
        if reading.bumper is None:
            return
        self._last_received_at = now
        before, self._pressed = self._pressed, reading.bumper
        if reading.bumper != before:
            edges = [self._edge(bearing) for bearing in (*before, *reading.bumper)]
            points = np.concatenate([NO_POINTS, *edges])
            self._felt.append((now, points_from_frame(track.at(reading.stamp), points)))

    def seen(self, here: Pose2D, radius: float) -> Floats:
        while self._felt and self._now - self._felt[0][0] > self.KEPT:
            self._felt.popleft()
        points = np.concatenate([NO_POINTS, *(points for _, points in self._felt)])
        return within(points, here, radius)

    def beside(self, bearings: Floats) -> Floats:
        """Return infinity: a bumper observes nothing before it is touched."""
        return np.full(len(bearings), np.inf)

    def _edge(self, bearing: float) -> Floats:
        """Return (n, 2) points just outside the footprint around a direction."""
        directions = np.column_stack([np.cos(bearing + self.FELT), np.sin(bearing + self.FELT)])
        towards = directions @ self._shape.normals.T
        with np.errstate(divide="ignore"):
            reach = np.where(towards > 0.0, self._shape.offsets / towards, np.inf).min(axis=1)
        points: Floats = directions * (reach + self.BEYOND)[:, None]
        return points


def within(points: Floats, here: Pose2D, radius: float) -> Floats:
    """Return (n, 2) the points (m, 2 or more) within `radius` metres of a robot at `here`, in its
    frame.
    """
    local = points_in_frame(here, points)
    near: Floats = local[np.hypot(local[:, 0], local[:, 1]) <= radius]
    return near


def _beside_cone(bearings: Floats, cone: Sonar | DepthCamera) -> Floats:
    off_axis = np.abs(np.remainder(bearings - cone.theta + math.pi, 2.0 * math.pi) - math.pi)
    beside: Floats = np.maximum(off_axis - cone.width / 2.0, 0.0)
    return beside


def sources_of(profile: Profile) -> Sequence[ObstacleSource]:
    """Return a robot's sensors of obstacles. Raises ValueError for an invalid footprint."""
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
