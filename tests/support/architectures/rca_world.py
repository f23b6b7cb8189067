"""The simulated robot behind a robot control architecture (RCA), for the tests of adapters: it
obeys velocities, plans short paths, and docks. `RcaRig` runs it in a thread beside the test.
"""

import asyncio
import math
import tempfile
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from robots.agent.adapters import registry
from robots.api.adapter_names import PROFILES
from robots.api.geometry import Pose2D, wrap_angle
from robots.simulator.physics.realtime import Playback
from robots.simulator.physics.simulation import Simulation
from robots.world.robot_models import model_of
from robots.world.sites import load_plan
from tests.support.patience import patient

TICK = 0.02
NEAR = 0.12
BEFORE_DOCK = {"giraff": "0.8,6.3,3.14159", "rhodon": "11.26,1.0,0.0"}


class RcaWorld:
    """One robot, in real time. `journey` is "", "running", "done" or "failed"; a non-zero velocity
    ends it.

    `believed` is the pose that its localization reports; a `deaf` localization ignores poses that
    it is given. Its planner accepts a goal after `accept_after` seconds, disregards the next
    `ignored_cancels` of the `cancels` that it receives, and does nothing while it is `hung`.
    """

    watchdog = None  # seconds, where it is another one than the simulated robot's

    def __init__(self, series, start="corridor-centre"):
        self.series, self.start = series, start
        self.reset()

    def reset(self, start=None):
        plan, _ = load_plan("office")
        model = model_of(self.series)
        model = model if self.watchdog is None else replace(model, watchdog=self.watchdog)
        self.sim = Simulation(model, plan, seed=3, start=start or self.start)
        self.playback = Playback(self.sim, time.monotonic(), time.time())
        self.journey, self.goal, self.kind = "", None, ""
        self.commands = []  # (monotonic time, linear, angular)
        self._map_from_world = Pose2D(0.0, 0.0, 0.0)
        self.deaf = False
        self.accept_after, self.ignored_cancels, self.cancels = 0.0, 0.0, 0
        self._late = None  # a goal, its kind, and when it is accepted
        self.hung = False

    @property
    def truth(self):
        return self.sim.pose

    @property
    def believed(self):
        return self._map_from_world.compose(self.sim.pose)

    def localize_at(self, place):
        self._map_from_world = place.compose(self.sim.pose.inverse())

    def drive(self, linear, angular):
        if self.journey == "running" and (linear or angular):
            self.journey = "failed"
        if self.journey != "running":
            self.commands.append((time.monotonic(), linear, angular))
            self._command(linear, angular)

    def _command(self, linear, angular):
        self.playback.advance(time.monotonic(), time.time())
        self.sim.command(linear, angular)

    def tilt(self, angle):
        self.sim.tilt_target = angle

    def go_to(self, x, y):
        self._accept(Pose2D(x, y, 0.0), "goto")

    def dock(self):
        place = self.sim.plan.dock_of(self.series)
        self._accept(Pose2D(place.x, place.y, place.theta), "dock")

    def undock(self):
        self._accept(self.sim.pose.compose(Pose2D(-0.3, 0.0, 0.0)), "undock")

    def _accept(self, goal, kind):
        if self.accept_after:
            self._late = goal, kind, time.monotonic() + self.accept_after
        else:
            self._late, self.journey, self.goal, self.kind = None, "running", goal, kind

    def cancel(self):
        """Return whether the planner obeyed."""
        self.cancels += 1
        if self.ignored_cancels > 0:
            self.ignored_cancels -= 1
            return False
        self._late = None
        if self.journey == "running":
            self.journey = "failed"
            self._command(0.0, 0.0)
        return True

    def pause(self):
        """End a journey without an event."""
        if self.journey == "running":
            self.journey = ""
            self._command(0.0, 0.0)

    def tick(self):
        """Advance the simulation to now."""
        self.playback.advance(time.monotonic(), time.time())
        if self._late is not None and time.monotonic() > self._late[2]:
            self.goal, self.kind, _ = self._late
            self._late, self.journey = None, "running"
        if self.journey == "running" and not self.hung:
            self._travel()

    def _travel(self):
        ahead = self.sim.pose.inverse().compose(self.goal)
        distance, bearing = math.hypot(ahead.x, ahead.y), math.atan2(ahead.y, ahead.x)
        if self.sim.docked if self.kind == "dock" else distance < NEAR:
            self.sim.command(0.0, 0.0)
            self.journey = "done"
        elif self.kind == "undock":
            self.sim.command(-0.25, 0.0)
        elif abs(bearing) > 0.3:
            self.sim.command(0.0, math.copysign(0.6, bearing))
        else:
            self.sim.command(
                0.2 if self.kind == "dock" else min(0.5, 0.15 + distance),
                0.8 * wrap_angle(bearing) if distance > NEAR else 0.0,
            )

    def ranges(self):
        """Return the beams in metres; (beams,), beyond the laser's range without an echo."""
        return np.nan_to_num(self.sim.scan(), posinf=self.sim.model.laser.range_max + 1.0)


class RcaRig:
    """A world and its RCA, on a loop in a thread, so that one rig serves many tests; use as a
    context manager. A subclass starts the RCA in `up`, publishes in `say` and ends it in `down`.
    """

    series = "giraff"
    adapter_name = ""

    def __init__(self, series=None):
        self.world = RcaWorld(series or self.series)
        self._directory = tempfile.TemporaryDirectory()
        self.loop = asyncio.new_event_loop()
        self.running = False
        self.errors = []
        self._thread = threading.Thread(target=self._serve, name="rca", daemon=True)
        self._ending = threading.Event()

    # of a subclass

    def options(self):
        """Return the options with which an adapter finds this RCA."""
        raise NotImplementedError

    async def up(self):
        """Start the RCA."""

    async def down(self):
        """Kill it."""

    async def say(self, count):
        """Publish the messages of this tick."""

    def freeze(self, *, on):
        """Stop the process that receives the adapter's velocities (SIGSTOP), or resume it."""
        raise NotImplementedError

    # for tests

    def __enter__(self):
        self._thread.start()
        self.revive()
        return self

    def __exit__(self, *_):
        try:
            self.kill()
        finally:
            self._ending.set()
            self._thread.join(10)

    def adapter(self, **options):
        return registry.create(self.adapter_name, self.profile, {**self.options(), **options})

    @property
    def profile(self):
        """The robot's profile, which allows its RCA to navigate without a guard."""
        path = Path(self._directory.name) / f"{self.world.series}.toml"
        shipped = (PROFILES / f"{self.world.series}.toml").read_text()
        path.write_text(f"unguarded_navigation = true\n{shipped}")
        return str(path)

    def call(self, work, within=15.0):
        return asyncio.run_coroutine_threadsafe(work, self.loop).result(patient(within))

    def revive(self):
        self.call(self._up())

    def kill(self):
        self.call(self._down())

    def reset(self, start=None):
        async def again():
            self.world.reset(start)
            await self.after_reset()

        self.call(again())

    async def after_reset(self):
        pass

    async def _up(self):
        if not self.running:
            await self.up()
            self.running = True

    async def _down(self):
        if self.running:
            self.running = False
            await self.down()

    def _serve(self):
        asyncio.set_event_loop(self.loop)
        try:
            self.loop.run_until_complete(self._ticking())
        finally:
            for task in asyncio.all_tasks(self.loop):
                task.cancel()
            self.loop.run_until_complete(asyncio.sleep(0.05))
            self.loop.close()

    async def _ticking(self):
        count = 0
        while not self._ending.is_set():
            self.world.tick()
            if self.running:
                try:
                    await self.say(count)
                except Exception as error:  # of any kind: the test fails with it
                    if self.running:
                        self.errors.append(error)
            count += 1
            await asyncio.sleep(TICK)
