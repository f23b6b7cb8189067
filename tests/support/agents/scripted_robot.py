"""An adapter that records every velocity with its time, and has its own watchdog."""

import asyncio
import threading
import time
from dataclasses import dataclass, field, replace

from robots.agent.ramp import ZERO
from robots.agent.robot_interface import (
    ActionProgress,
    ActionRefusedError,
    AdapterError,
    Profile,
    RcaState,
)
from robots.agent.timing import TimeSource
from robots.api import messages as m

LIMITS = m.Limits(
    linear=0.7,
    reverse=0.4,
    angular=0.9,
    linear_acceleration=4.0,
    angular_acceleration=8.0,
    linear_braking=4.0,
    angular_braking=8.0,
)
WATCHDOG = 0.3
PROFILE = Profile(
    series="Scripted",
    rca="test",
    capabilities=("velocity", "goto", "dock", "tilt", "relocalize", "say"),
    limits=LIMITS,
    footprint=((0.2, 0.2), (0.2, -0.2), (-0.2, -0.2), (-0.2, 0.2)),
    watchdog=WATCHDOG,
)


def still(**fields):
    """A reading of a localized robot at rest."""
    values = {
        "stamp": time.time(),
        "pose": m.Pose(x=1.0, y=2.0, theta=0.5),
        "velocity": ZERO,
        "battery": m.Battery(charge=0.8),
    } | fields
    return RcaState(**values)


@dataclass
class ScriptedRobot:
    """Set the attributes from the test's thread; they are read at 50 Hz."""

    profile: Profile = PROFILE
    reading: RcaState = field(default_factory=still)
    lost: str = ""  # non-empty: every connection fails or ends with this sentence
    silent: bool = False  # connected, and reporting nothing
    deaf: bool = False  # reporting, but refusing velocities
    refuses: str = ""  # non-empty: no action can be started
    hanging: bool = False  # an action that is started never answers
    finishes: bool = True  # actions run until their end, instead of for ever
    # the clock of its readings and of the velocities that it receives
    times: TimeSource = field(default_factory=TimeSource)

    def __post_init__(self):
        self.lock = threading.Lock()
        self.applied = []  # (monotonic time, velocity)
        self.started, self.cancelled, self.configs = [], [], []
        self.connections = 0
        self.closed = False
        self._progress = None

    async def connect(self):
        self.connections += 1
        if self.lost:
            raise AdapterError(self.lost)
        self._progress = asyncio.Queue()

    def apply(self, velocity):
        if self.lost or self.deaf:
            raise AdapterError(self.lost or "the base does not listen")
        with self.lock:
            self.applied.append((self.times.now(), velocity))
        return velocity

    async def start(self, action):
        if self.hanging:
            await asyncio.Future()
        if self.refuses:
            raise ActionRefusedError(self.refuses)
        self.started.append(action)
        self.report(action.action_id, "RUNNING")
        if self.finishes:
            self.report(action.action_id, "FINISHED")

    async def cancel(self, action_id):
        self.cancelled.append(action_id)
        self.report(action_id, "CANCELLED")
        return True

    def report(self, action_id, status, reason=""):
        self._progress.put_nowait(ActionProgress(action_id, status, reason))

    async def states(self):
        while True:
            if self.lost:
                raise AdapterError(self.lost)
            if not self.silent:
                yield replace(self.reading, stamp=self.times.unix())
            await asyncio.sleep(0.02)

    async def progress(self):
        while True:
            yield await self._progress.get()

    def video(self):
        return None

    def audio(self):
        return None

    def configure(self, config):
        self.configs.append(config)

    async def close(self):
        self.closed = True

    # --- for tests --------------------------------------------------------------------------------

    def velocities(self, since=0.0):
        with self.lock:
            return [(at, velocity) for at, velocity in self.applied if at >= since]

    @property
    def told(self):
        """The last velocity of the base."""
        velocities = self.velocities()
        return velocities[-1][1] if velocities else ZERO

    def base_at(self, moment):
        """The base's velocity at a moment, zero after its watchdog."""
        before = [(at, velocity) for at, velocity in self.velocities() if at <= moment]
        return before[-1][1] if before and moment - before[-1][0] < self.profile.watchdog else ZERO


class NavigatingRobot(ScriptedRobot):
    """One whose architecture drives it, at `GOING`, from the start of an action until that is
    cancelled. The base executes the last velocity that it received, and the architecture sends
    fifty a second, so that zeros of the agent have no effect until then.
    """

    GOING = m.Velocity(linear=0.5, angular=0.0)

    def __post_init__(self):
        super().__post_init__()
        self.finishes = False
        self.going = False
        self.cancel_hangs = self.ignores_cancel = False
        self.cancel_fails = ""
        self.ignored_cancels = 0  # the next ones
        self.rolls_until = 0.0  # after the end of the action

    @property
    def motion(self):
        now = self.times.now()
        return self.GOING if self.going or now < self.rolls_until else self.base_at(now)

    async def start(self, action):
        await super().start(action)
        self.going = not isinstance(action, m.Tilt)

    async def cancel(self, action_id):
        if self.cancel_hangs:
            await asyncio.Future()
        if self.cancel_fails:
            raise AdapterError(self.cancel_fails)
        if self.ignores_cancel or self.ignored_cancels > 0:
            self.ignored_cancels -= 1
            self.cancelled.append(action_id)
            return False
        self.halt()
        return await super().cancel(action_id)

    def halt(self, rolls=0.2):
        """End the action; the base rolls on for a moment."""
        if self.going:
            self.going, self.rolls_until = False, self.times.now() + rolls

    async def states(self):
        async for reading in super().states():
            yield replace(reading, velocity=self.motion)


class SelfDrivingRobot(ScriptedRobot):
    """A robot whose navigation runs in the agent; `wish` is its wanted velocity."""

    wish = ZERO
    dock = None

    def __post_init__(self):
        super().__post_init__()
        self.floorplans, self.points = [], []

    def wanted(self):
        return (
            self.wish if self.started and self.started[-1].action_id not in self.cancelled else None
        )

    def located(self, reading, points):
        self.points.append(points)
        return reading

    def take_floorplan(self, update):
        self.floorplans.append(update)
