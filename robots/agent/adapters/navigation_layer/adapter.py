"""Localization and navigation for a robot that lacks them: beside any adapter that gives velocity,
odometry and a laser.

    inner adapter ──reading──► navigation process ──► pose, wanted velocity, path

Each capability that the RCA names stays its own. If it knows its pose, our navigation uses that.

This adapter adds actions, a pose and a path. It sends no velocities: those of navigation pass
through the safety kernel like a driver's command (robot_interface.Navigating), and only while an
action of ours runs, so cancelling one ends it at once, even when the navigation process hangs. If
that process is late, the robot stops; if it stays silent, it is killed, its action fails with the
reason, and the next process starts from the last known pose.
"""

import asyncio
import math
import time
from collections.abc import AsyncIterator, Callable, Coroutine
from dataclasses import replace
from pathlib import Path
from typing import Any

import structlog

from robots.agent.adapters.common.progress_queue import ProgressQueue
from robots.agent.adapters.navigation_layer.child import NavigationProcess, Orderable
from robots.agent.adapters.navigation_layer.pose_memory import PoseMemory
from robots.agent.autonomy import wire
from robots.agent.autonomy.area import dock_of
from robots.agent.autonomy.pose_extrapolator import PoseExtrapolator
from robots.agent.autonomy.sensor_snapshot import Body, NavigationOutput, SensorSnapshot
from robots.agent.ramp import ZERO
from robots.agent.robot_interface import (
    ActionProgress,
    ActionRefusedError,
    Adapter,
    AdapterError,
    AudioSource,
    Display,
    LimitsSpeed,
    PassesVelocities,
    Profile,
    RcaState,
    Speaker,
    VideoSource,
    WithLock,
    outputs_of,
)
from robots.agent.timing import Cadence
from robots.api.floorplan import ChargingDock as Station
from robots.api.geometry import Pose2D
from robots.api.messages import (
    ENDED,
    Action,
    Capability,
    FloorPlanUpdate,
    Laser,
    Point,
    Relocalize,
    Velocity,
)
from robots.api.reasons import ReasonCode
from robots.world.sensing import Floats, LaserScan, beams_of

SNAPSHOT_PERIOD = 0.1  # seconds, for the navigation process
LATE = 0.3  # seconds without its output after which the robot stops
# and after which the process is killed: while an action runs, while none does
STUCK, STUCK_IDLE = 1.0, 3.0
# m and rad: how exactly a robot is placed at its start
START_SPREAD, START_TURN = 0.15, math.radians(8.0)
# m and rad: how far it may have moved since its last known pose
AGAIN_SPREAD, AGAIN_TURN = 0.25, math.radians(15.0)
OURS: tuple[Capability, ...] = ("localization", "goto", "follow", "dock", "undock", "relocalize")
LOCALIZATION: frozenset[Capability] = frozenset({"localization", "relocalize"})

log = structlog.stdlib.get_logger(__name__)


def wrapped(inner: Adapter, area: FloorPlanUpdate | None, memory: Path | None = None) -> Adapter:
    """Return the adapter with the localization and the navigation that its RCA lacks; unchanged
    when it has both, or no laser.

    An RCA with localization but without navigation gets ours, on its own pose. `area` is the site,
    None when the server will send it; `memory` is the file of the last pose.
    """
    profile = inner.profile
    if profile.laser is None or {"localization", "goto"} <= set(profile.capabilities):
        return inner
    return AutonomyAdapter(inner, profile.laser, area, memory)


class AutonomyAdapter:
    """See robot_interface.Adapter; it has the optional members that the inner adapter has."""

    set_lock: Callable[..., None]
    limit_speed: Callable[[float], None]
    preview: Callable[[float, float], Coroutine[Any, Any, tuple[tuple[Point, ...], str]]]

    def __init__(
        self,
        inner: Adapter,
        laser: Laser,
        area: FloorPlanUpdate | None,
        memory: Path | None = None,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        own = inner.profile
        self.inner = inner
        self._localizes = "localization" in own.capabilities
        self._ours = (
            frozenset(OURS)
            - frozenset(own.capabilities)
            - (LOCALIZATION if self._localizes else frozenset())
        )
        self.profile: Profile = replace(
            own, capabilities=(*own.capabilities, *(name for name in OURS if name in self._ours))
        )
        self._laser, self._now = laser, now
        self._knows_site = area is not None
        self._memory = PoseMemory(memory)
        self._pose_buffer = PoseExtrapolator()
        self.node = NavigationProcess(
            Body(own.series, own.footprint, own.limits, self._localizes),
            output=self._take_output,
            settled=self._place,
        )
        self._area: FloorPlanUpdate | None = None
        self.dock: Station | None = None
        self._news = ProgressQueue()
        self._due = Cadence(SNAPSHOT_PERIOD)
        self._last: RcaState | None = None
        self._beams: LaserScan | None = None
        self._sent_sweep = -math.inf
        self._path: tuple[Point, ...] = ()
        self._wish: Velocity | None = None
        self._starting: set[str] = set()  # actions that the navigation process has not answered
        self._running: str | None = None  # the action that moves the robot
        self._looking: set[str] = set()  # actions that localize it
        self._last_received_at = -math.inf
        if isinstance(inner, WithLock):
            self.set_lock = inner.set_lock
        if isinstance(inner, LimitsSpeed):
            self.limit_speed = inner.limit_speed
        if "goto" in self._ours:
            self.preview = self._preview
        if area is not None:
            self._settle(area)

    async def connect(self) -> None:
        """Connect the RCA (raises AdapterError); start the navigation process without waiting."""
        await self.inner.connect()
        await self._memory.read()
        self._last = self._beams = None
        self.node.run()

    def apply(self, velocity: Velocity) -> Velocity:
        return self.inner.apply(velocity)

    def wanted(self) -> Velocity | None:
        """Return the running action's velocity, zero when late; without one, the RCA's own."""
        if self._running is None:
            return self.inner.wanted() if isinstance(self.inner, PassesVelocities) else None
        late = self._now() - self._last_received_at > LATE
        return ZERO if late or self._wish is None else self._wish

    def take_floorplan(self, update: FloorPlanUpdate) -> None:
        """Use the server's map, unless the robot's own configuration names the site."""
        if self._knows_site:
            if self._area is not None and update.map_id != self._area.map_id:
                log.warning("floorplan_ignored", map=update.map_id, site=self._area.map_id)
        elif update != self._area:
            self._end_all(ReasonCode.MAP_CHANGED)
            self._settle(update)

    async def start(self, action: Action) -> None:
        """Start an action, of ours or of the RCA's; errors as in robot_interface.Adapter. A refused
        action of ours never runs, because its velocities are ignored.
        """
        name = type(action).__struct_config__.tag
        if not isinstance(action, Orderable) or name not in self._ours:
            await self.inner.start(action)
            return
        if not isinstance(action, Relocalize) and (self._beams is None or self._last is None):
            raise ActionRefusedError(ReasonCode.NO_LASER)
        if not isinstance(action, Relocalize) and self._running is not None:
            raise ActionRefusedError(ReasonCode.BUSY)
        await self._order(action)
        self._news.put(ActionProgress(action.action_id, "RUNNING"))
        if isinstance(action, Relocalize):
            self._looking.add(action.action_id)
        else:
            self._running, self._wish, self._last_received_at = action.action_id, None, self._now()

    async def _order(self, action: Orderable) -> None:
        began = False
        self._starting.add(action.action_id)
        try:
            await self.node.order(action)
            began = action.action_id in self._starting
        except AdapterError as error:
            raise ActionRefusedError(str(error)) from error
        finally:
            self._starting.discard(action.action_id)
            if not began:
                self.node.send(wire.CancelAction(action.action_id))
        if not began:
            raise ActionRefusedError(ReasonCode.CANCELLED)

    async def _preview(self, x: float, y: float) -> tuple[tuple[Point, ...], str]:
        """See robot_interface.PreviewsRoutes."""
        found = await self.node.route(x, y)
        return found.points, found.reason

    async def cancel(self, action_id: str) -> bool:
        """End an action of ours at once; ask the RCA to end one of its own."""
        if action_id in self._starting:
            self._starting.discard(action_id)
            return True
        if action_id == self._running or action_id in self._looking:
            self.node.send(wire.CancelAction(action_id))
            self._end(ActionProgress(action_id, "CANCELLED", ReasonCode.CANCELLED))
            return True
        return await self.inner.cancel(action_id)

    async def states(self) -> AsyncIterator[RcaState]:
        """Yield the RCA's states; `located` adds our pose and path."""
        try:
            async for reading in self.inner.states():
                yield reading
        finally:
            self._end_all(ReasonCode.NOT_CONNECTED)

    async def progress(self) -> AsyncIterator[ActionProgress]:
        """Yield news of actions, the RCA's and ours; raises the RCA's AdapterError."""
        pump = asyncio.ensure_future(self._pump())
        try:
            while True:
                yield await self._news.get()
        finally:
            pump.cancel()
            await asyncio.gather(pump, return_exceptions=True)

    def video(self) -> VideoSource | None:
        return self.inner.video()

    def audio(self) -> AudioSource | None:
        return self.inner.audio()

    def speaker(self) -> Speaker | None:
        return outputs_of(self.inner)[0]

    def display(self) -> Display | None:
        return outputs_of(self.inner)[1]

    def configure(self, config: Any) -> None:
        self.inner.configure(config)

    async def close(self) -> None:
        self._end_all(ReasonCode.AGENT_ENDS)
        try:
            await self.inner.close()
        finally:
            await self.node.close()
            is_known = self._pose_buffer.trusted and not self._localizes
            if self._area is not None and self._last is not None and is_known:
                place = self._pose_buffer.place(self._last.odometry)
                await self._memory.close(self._area.map_id, place)

    # --- readings ---------------------------------------------------------------------------------

    def located(self, reading: RcaState, points: Floats) -> RcaState:
        """See robot_interface.Navigating. Raises what ended the task that restarts the process."""
        self.node.check()
        now = self._now()
        self._perceive(reading, points, now)
        self._watch(now)
        pose = reading.pose if self._localizes else self._pose_buffer.pose(reading.odometry, now)
        if pose.localized and self._area is not None and not self._localizes:
            self._memory.note(self._area.map_id, Pose2D(pose.x, pose.y, pose.theta), now)
        errors = (*reading.errors, *self._errors(reading))
        return replace(reading, pose=pose, errors=errors, path=self._path)

    def _perceive(self, reading: RcaState, points: Floats, now: float) -> None:
        if reading.odometry is None:
            return
        self._last = reading
        beams = None if reading.scan is None else beams_of(reading.scan, self._laser)
        self._beams = beams or self._beams
        if self.node.ready and self._due.due(now):
            pose = reading.pose if self._localizes else None
            moment = SensorSnapshot(
                reading.stamp,
                reading.odometry,
                reading.velocity,
                reading.charger_contact,
                self._beams,
                points,
                pose,
            )
            new = self._beams is not None and self._beams.stamp != self._sent_sweep
            if self.node.send(wire.perceive(moment, new=new)) and self._beams is not None:
                self._sent_sweep = self._beams.stamp

    def _errors(self, reading: RcaState) -> tuple[str, ...]:
        if reading.odometry is None:
            return ("the robot gives no odometry",)
        if self._localizes and self._area is None:
            return ()  # without a map, the robot can be driven as usual
        return () if self.node.ready else (f"navigation: {self.node.problem}",)

    # --- the navigation process -------------------------------------------------------------------

    def _settle(self, area: FloorPlanUpdate) -> None:
        self._area = area
        self.dock = dock_of(area, self.profile.series)
        self._pose_buffer = PoseExtrapolator()
        self.node.settle(area)

    def _place(self) -> None:
        """Send a new process the robot's last known pose, or its start."""
        self._last_received_at, self._sent_sweep = self._now(), -math.inf
        odometry = self._last.odometry if self._last else None
        known = self._pose_buffer.place(odometry) if self._pose_buffer.trusted else None
        if known is not None:
            self.node.send(wire.KnownPlace(known, AGAIN_SPREAD, AGAIN_TURN))
        elif self.profile.start is not None and not self._pose_buffer.has_output:
            self.node.send(wire.KnownPlace(self.profile.start, START_SPREAD, START_TURN))
        elif (
            not self._pose_buffer.has_output
            and self._area is not None
            and (kept := self._memory.recall(self._area.map_id))
        ):
            self.node.send(wire.KnownPlace(kept, AGAIN_SPREAD, AGAIN_TURN))

    def _take_output(self, output: NavigationOutput) -> None:
        now = self._now()
        self._last_received_at, self._wish = now, output.wanted
        self._pose_buffer.take(output, now)
        if output.path is not None:
            self._path = output.path
        for news in output.news:
            if news.action_id == self._running or news.action_id in self._looking:
                take = self._end if news.status in ENDED else self._news.put
                take(news)

    def _watch(self, now: float) -> None:
        silent = now - self._last_received_at
        if not self.node.ready:
            self._end_all(ReasonCode.NAVIGATION_LOST.of(self.node.problem))
        elif silent > (STUCK if self._running else STUCK_IDLE):
            self._end_all(ReasonCode.NAVIGATION_LOST.of("silent"))
            self.node.give_up("it does not answer")

    def _end_all(self, reason: str) -> None:
        self._starting.clear()
        for action_id in ([self._running] if self._running else []) + sorted(self._looking):
            self.node.send(wire.CancelAction(action_id))
            self._end(ActionProgress(action_id, "FAILED", reason))

    def _end(self, news: ActionProgress) -> None:
        self._looking.discard(news.action_id)
        if news.action_id == self._running:
            self._running, self._wish, self._path = None, None, ()
        self._news.put(news)

    async def _pump(self) -> None:
        try:
            async for news in self.inner.progress():
                self._news.put(news)
        except AdapterError as error:
            self._news.put(error)
