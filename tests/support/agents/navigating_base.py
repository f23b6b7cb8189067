"""An architecture with a base, its own navigation, and a connection that can be cut, for
`run_robot NAME --check`. Its time is that of a `TimeSource`.
"""

import asyncio
import dataclasses

import msgspec

from robots.agent.ramp import ZERO
from robots.agent.robot_interface import ActionProgress, ActionRefusedError, AdapterError
from robots.api.geometry import Pose2D
from robots.api.messages import Pose, Velocity
from tests.support.agents.scripted_robot import PROFILE, still

LIMITS = msgspec.structs.replace(
    PROFILE.limits, linear=0.5, linear_acceleration=0.4, linear_braking=0.8
)
STEP = 0.01  # s
LOCALIZED = Pose(x=4.0, y=2.0, theta=0.5)


class NavigatingBase:
    """Drives to its goal at `speed` m/s.

    `control` is what really stops it, `stated` what its adapter states. In "agent" its planner's
    velocities are only offered to the agent (`wanted`), and its base obeys the agent until its
    watchdog strikes. A guard stops it `guard` seconds after the connection was cut.
    """

    def __init__(self, times, control, stated="same", *, speed=0.3, guard=0.5):
        self.times, self.control, self.speed, self.guard = times, control, speed, guard
        stated = control if stated == "same" else stated
        self.profile = dataclasses.replace(
            PROFILE,
            capabilities=("velocity", "localization", "goto"),
            navigation_control=stated,
            limits=LIMITS,
        )
        self.pose, self.docked = LOCALIZED, False
        self.refuses, self.fails, self.confirms = "", "", True
        self.travelled, self.velocity = 0.0, 0.0
        self.left = 0.0  # m to the goal
        self.told = (-1e9, ZERO)  # by the agent
        self.connected, self.cut_at = False, 1e9
        self.cancelled, self.goals = [], []
        self.unreachable = ""
        self._at = times.now()
        self._progress = asyncio.Queue()

    # --- the robot ---

    def live(self):
        """Let the robot do what it did until now."""
        while self._at < self.times.now() - 1e-9:
            self._at += STEP
            self.velocity = self._driven()
            self.travelled += self.velocity * STEP
            self.left = max(0.0, self.left - abs(self.velocity) * STEP)

    def _driven(self):
        planned = self.speed if self.left > 0.0 else 0.0
        if self.control == "guarded" and self._at - self.cut_at > self.guard:
            self.left = planned = 0.0
        at, velocity = self.told
        commanded = velocity.linear if self._at - at < self.profile.watchdog else 0.0
        return commanded if self.control == "agent" else planned or commanded

    # --- the adapter ---

    async def connect(self):
        if self.unreachable:
            raise AdapterError(self.unreachable)
        self.live()
        if self.confirms:
            self.left = 0.0  # what an earlier connection has left
        self.connected, self.cut_at = True, 1e9

    def sever(self):
        self.live()
        self.connected, self.cut_at = False, self.times.now()

    def apply(self, velocity):
        self.live()
        if not self.connected:
            raise AdapterError("not connected")
        self.told = (self.times.now(), velocity)
        return velocity

    async def start(self, action):
        if self.refuses:
            raise ActionRefusedError(self.refuses)
        self.live()
        self.goals.append(action)
        if self.fails:
            self._progress.put_nowait(ActionProgress(action.action_id, "FAILED", self.fails))
            return
        self.left = Pose2D(action.x, action.y, 0.0).distance(Pose2D(self.pose.x, self.pose.y, 0.0))

    async def cancel(self, action_id):
        self.live()
        if self.connected and self.confirms:
            self.left = 0.0
        self.cancelled.append(action_id)
        return self.connected and self.confirms

    async def states(self):
        while self.connected:
            self.live()
            yield still(
                stamp=self.times.unix(),
                pose=self.pose,
                velocity=Velocity(linear=self.velocity, angular=0.0),
                odometry=Pose2D(self.travelled, 0.0, 0.0),
                charger_contact=self.docked,
            )
            await asyncio.sleep(0.02)
        raise AdapterError("not connected")

    async def progress(self):
        while True:
            yield await self._progress.get()

    def video(self):
        return None

    async def close(self):
        self.connected = False


class ThroughAgent(NavigatingBase):
    """One whose adapter offers the planner's velocities to the agent."""

    def wanted(self):
        self.live()
        return Velocity(linear=self.speed, angular=0.0) if self.left > 0.0 else None


class Sealed(NavigatingBase):
    """One whose adapter cannot cut its connection."""

    sever = None
