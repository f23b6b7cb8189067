"""A whole robot's autonomy without threads, processes or clocks, for tests and benchmarks."""

from dataclasses import replace

import numpy as np

from robots.agent.autonomy.area import Area
from robots.agent.autonomy.navigation_node import NavigationNode
from robots.agent.autonomy.pose_extrapolator import PoseExtrapolator
from robots.agent.autonomy.sensor_snapshot import Body, NavigationOutput, SensorSnapshot
from robots.agent.ramp import ZERO
from robots.agent.robot_interface import ActionProgress
from robots.agent.safety.collision_monitor import CollisionMonitor
from robots.agent.safety.obstacle_sources import LaserSource
from robots.agent.timing import Cadence
from robots.api.geometry import Pose2D
from robots.api.messages import Action, AssistLevel, Laser, Point, Pose, Velocity

THINKING = 0.1  # seconds between two thoughts


class Headless:
    """Give it every moment; it answers with the velocity that its action wants, or that it makes of
    a driver's.

    `news` gathers what became of actions, `output` is the newest one, `path` what the robot
    follows.
    """

    def __init__(
        self, body: Body, area: Area, rng: np.random.Generator, *, period: float = THINKING
    ) -> None:
        """Read the map; raises AreaError."""
        self._laser = LaserSource(Laser(x=0.0))  # sweeps come with their mount
        self.monitor = CollisionMonitor(body.footprint, body.limits, [self._laser])
        self._told = ZERO
        self.node = NavigationNode(area, body, rng)
        self.pose_extrapolator = PoseExtrapolator()
        self.news: list[ActionProgress] = []
        self.output: NavigationOutput | None = None
        self.path: tuple[Point, ...] = ()
        self._due = Cadence(period)
        self._moment: SensorSnapshot | None = None

    @property
    def pose(self) -> Pose:
        """Where the robot believes to be."""
        moment = self._moment
        return self.pose_extrapolator.pose(
            moment.odometry if moment else None, moment.stamp if moment else 0.0
        )

    def place(self, pose: Pose2D) -> None:
        """Hear where the robot is."""
        self.node.place(pose)

    def begin(self, action: Action) -> None:
        """Start a goto, follow, dock, undock or relocalize; raises ActionError."""
        self.node.begin(action)

    def step(self, moment: SensorSnapshot) -> Velocity:
        """Take a moment and return the action's velocity, ZERO without one; 20 Hz or more."""
        before, self._moment = self._moment, moment
        new = moment.beams is not None and (before is None or moment.beams is not before.beams)
        self.monitor.moved(moment.stamp, moment.odometry)
        if new and moment.beams is not None:
            self._laser.look(moment.beams, self.monitor.track, moment.stamp)
        if self._due.due(moment.stamp):
            self.output = self.node.step(replace(moment, points=self.monitor.points()))
            self.pose_extrapolator.take(self.output, moment.stamp)
            self.news += self.output.news
            self.path = self.path if self.output.path is None else self.output.path
        wanted = self.output.wanted if self.output else None
        if wanted is not None:
            self._told = wanted
        return wanted or ZERO

    def assist(self, wanted: Velocity, level: AssistLevel) -> Velocity:
        """Return what a driver who asks for `wanted` gets at a level of assistance."""
        self._told = self.monitor.shape(
            wanted, self._told, level, self._moment.stamp if self._moment else 0.0
        ).velocity
        return self._told
