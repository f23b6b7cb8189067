"""The base of adapters for an RCA outside of the agent: everything but its protocol.

A subclass connects (`_open`, `_shut`, `_cut`), sends a velocity (`_drive`), checks that the RCA
reads what it is sent (`_ask`), and starts and cancels actions (`_order`, `_withdraw`,
`_cancel_leftovers`, `_turn_head`). It puts received values into `readings`, the progress of
actions into `pending_actions`, and calls `_lose` when the connection is lost. velocity_gate.py
decides when a velocity may be sent.
"""

import asyncio
import contextlib
import math
import time
from abc import ABC, abstractmethod
from collections.abc import AsyncIterator
from dataclasses import fields
from typing import Any

import structlog

from robots.agent.adapters.common.pending_actions import (
    LONGEST_DOCKING,
    LONGEST_TILT,
    Kind,
    PendingAction,
    PendingActions,
)
from robots.agent.adapters.common.progress_queue import ProgressQueue
from robots.agent.adapters.common.robot_profile import (
    SHARED,
    BatteryRange,
    ObstacleSensor,
    RobotProfile,
    check_sensors,
)
from robots.agent.adapters.common.state_builder import Readings
from robots.agent.adapters.common.velocity_gate import GateParams, VelocityGate
from robots.agent.ramp import ZERO, caps, is_within
from robots.agent.robot_interface import (
    ActionProgress,
    ActionRefusedError,
    AdapterError,
    AudioSource,
    NavigationControl,
    Profile,
    RcaState,
    VideoSource,
)
from robots.api import docked
from robots.api.docked import DockReading, DockState
from robots.api.messages import Action, Capability, Dock, Goto, Relocalize, Tilt, Undock, Velocity
from robots.api.reasons import ReasonCode
from robots.process.cancellation import cancel
from robots.process.logs import reason_of

CONNECT_TIME = 5.0
FIRST_READING = 5.0
SILENCE = 1.0
PERIOD = 0.08  # seconds after which a state is repeated without news
POLL_PERIOD = 0.05  # seconds between two checks of actions
CANCEL_AGAIN = 0.5  # seconds between two cancels of an action of which the end is not confirmed
CANCEL_TIME = 1.0  # seconds for the first cancel of what an earlier connection has left
BRAKING_TIME = 2.0
GATE = GateParams()

log = structlog.stdlib.get_logger(__name__)


def profile_of(
    robot: RobotProfile,
    rca: str,
    watchdog: float,
    *,
    own: tuple[Capability, ...] = (),
    sensors: tuple[ObstacleSensor, ...] = (),
    control: NavigationControl | None = None,
    advice: str = "",
) -> Profile:
    """Return a robot's share of the factsheet.

    `watchdog` is the base's own, in seconds, `own` what the robot can do besides driving, in this
    RCA. `sensors` are those for obstacles, besides a laser, that the adapter delivers. `control` is
    what stops the RCA's own navigation when the agent is lost; where nothing does, and the profile
    does not allow that, an AdapterError gives the owner the `advice`.
    """
    check_sensors(robot, rca, sensors)
    if control == "unguarded" and not robot.unguarded_navigation:
        raise AdapterError(
            f"nothing would stop the navigation of {robot.series} if the agent were lost: {advice},"
            " or set unguarded_navigation = true in the robot's profile"
        )
    tilts = robot.tilt is not None and "tilt" in own
    shared = {
        name: getattr(robot, name) for name in SHARED & {each.name for each in fields(Profile)}
    }
    return Profile(
        **shared
        | {
            "rca": rca,
            "capabilities": ("velocity", *(each for each in own if each != "tilt" or tilts)),
            "watchdog": watchdog,
            "tilt": robot.tilt if tilts else None,
            "laser": robot.laser if "scan" in own else None,
            "navigation_control": control,
        }
    )


def check_tilt(profile: Profile, action: Tilt) -> None:
    """Raise ActionRefusedError when the head cannot tilt, or not to that angle."""
    reach = profile.tilt
    if reach is None:
        raise ActionRefusedError(ReasonCode.UNSUPPORTED)
    if not reach.minimum <= action.angle <= reach.maximum:
        span = f"{reach.minimum:g} to {reach.maximum:g} rad"
        raise ActionRefusedError(ReasonCode.OUT_OF_RANGE.of(span))


class RemoteAdapter(ABC):
    """See robot_interface.Adapter. `place` names the RCA in sentences, `vital` its readings."""

    place = "the robot control architecture"
    vital = "its readings"
    must_answer = True  # whether an RCA that answers no probe counts as lost, despite its readings
    connect_time: float | None = None  # seconds, if not CONNECT_TIME
    gate_params: GateParams | None = None  # if not GATE

    def __init__(self, profile: Profile, battery: BatteryRange | None = None) -> None:
        self.profile = profile
        self._battery = battery
        self.readings = Readings(battery)
        self.pending_actions = PendingActions(self._tell)
        self._gate = VelocityGate(self.gate_params or GATE, time.monotonic())
        self._failure = "not connected"
        self._progress = ProgressQueue()
        self._news = asyncio.Event()
        self._tasks: set[asyncio.Task[None]] = set()

    # --- what a subclass implements ---------------------------------------------------------------

    @abstractmethod
    async def _open(self) -> None:
        """Reach the RCA and subscribe; raises AdapterError, OSError or TimeoutError."""

    @abstractmethod
    async def _shut(self) -> None:
        """Disconnect; also called when the RCA was never reached, or is lost."""

    @abstractmethod
    def _drive(self, velocity: Velocity) -> None:
        """Send a velocity, at once; raises AdapterError when the RCA does not take it."""

    async def _ask(self) -> None:
        """Wait until the RCA has read what was sent; raises AdapterError when it is gone."""

    def _cut(self) -> None:
        """Discard what the lost RCA has not received yet; at once."""

    def _why_not_received(self) -> str:
        """Return why no velocity would be received, in a sentence, "" while one would."""
        return ""

    async def _settle(self) -> None:
        """Wait briefly for subscribers, which may be found after the first reading."""

    def _why_silent(self) -> str:
        """Return why `vital` readings are missing, in a sentence, "" when unknown."""
        return ""

    async def _order(self, action: Action) -> PendingAction:
        """Start an action at the RCA and return what to wait for; errors as in `start`."""
        raise ActionRefusedError(ReasonCode.UNSUPPORTED)

    async def _withdraw(self, pending: PendingAction) -> bool:
        """Cancel an action at the RCA; called again every 0.5 s until it returns True.

        Return True when the RCA has confirmed, now or earlier, that the action does not run and
        never will. Raises AdapterError when the RCA does not take the cancel.
        """
        raise NotImplementedError

    async def _cancel_leftovers(self) -> None:
        """Cancel the actions of an earlier run of the agent, after `_open`, before anything else is
        sent. `connect` cancels those of this run.
        """

    def _look(self, now: float) -> None:
        """Check time-outs; called twenty times a second."""

    def _turn_head(self, angle: float) -> None:
        """Tilt the head to an angle in radians."""

    # --- what a subclass uses ---------------------------------------------------------------------

    def _received(self) -> None:
        """Note a reading: wake the reader of `states`, and send what the gate permits now."""
        self._news.set()
        now = time.monotonic()
        self._gate.received(now)
        self._probe_if_due(now)

    def _probe_if_due(self, now: float) -> None:
        if not self._failure and self._gate.ask(now):
            self._run(self._ask_and_drive())

    async def _ask_and_drive(self) -> None:
        await self._ask()
        velocity = self._gate.answered(time.monotonic())
        if velocity is not None and not self._failure:
            self._drive(velocity)

    def _send_zero(self, now: float) -> None:
        self._gate.stood(now)
        self._drive(ZERO)

    def _lose(self, reason: str) -> None:
        """Note that the RCA is lost, and why; the first reason counts."""
        if not self._failure:
            self._failure = reason
            log.warning("rca_lost", rca=self.profile.rca, reason=reason)
            self._cut()
        self._news.set()

    def _run(self, work: Any) -> None:
        """Run a coroutine while connected; its failure ends the connection."""
        task = asyncio.ensure_future(work)
        self._tasks.add(task)
        task.add_done_callback(self._ended)

    def _ended(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            self._lose(reason_of(error))

    def _pending(self, action: Action) -> PendingAction:
        """Return what to wait for after an action was sent."""
        now = time.monotonic()
        match action:
            case Goto(x=x, y=y) if x is not None and y is not None:
                return PendingAction(action.action_id, "goto", now, (x, y))
            case Goto(place=place):
                return PendingAction(action.action_id, "goto", now, place=place or "")
        kind: Kind = "dock" if isinstance(action, Dock) else "undock"
        return PendingAction(action.action_id, kind, now, deadline=now + LONGEST_DOCKING)

    # --- the contract -----------------------------------------------------------------------------

    async def connect(self) -> None:
        """Reach the RCA and wait for a reading; raises AdapterError."""
        await self._disconnect("reconnecting")
        estop = self.readings.estop
        self.readings = Readings(self._battery)
        self.readings.estop = estop  # the last known state counts until it is reported again
        self._failure = ""
        try:
            async with asyncio.timeout(self.connect_time or CONNECT_TIME):
                await self._open()
                await self._cancel_leftovers()
            self._gate = VelocityGate(self.gate_params or GATE, time.monotonic())
            await self._cancel_pending()
            self._send_zero(time.monotonic())  # an earlier client may have driven
            await self._first_reading()
            await self._settle()
            self._run(self._watch())
        except (OSError, TimeoutError) as error:
            await self._disconnect("not connected")
            late = f"it is not connected after {self.connect_time or CONNECT_TIME:.0f} s"
            raise AdapterError(f"{self.place} does not answer: {str(error) or late}") from error
        except AdapterError:
            await self._disconnect("not connected")
            raise
        log.info("rca_connected", rca=self.profile.rca, place=self.place)

    async def _first_reading(self) -> None:
        try:
            async with asyncio.timeout(FIRST_READING):
                while self.readings.last_received_at == -math.inf and not self._failure:
                    self._news.clear()
                    await self._news.wait()
        except TimeoutError as error:
            why = self._why_silent()
            raise AdapterError(
                f"{self.place} is connected, but has not sent {self.vital}"
                + (f": {why}" if why else "")
            ) from error
        if self._failure:
            raise AdapterError(self._failure)

    def apply(self, velocity: Velocity) -> Velocity:
        """Send a velocity, within the base's limits, as soon as the RCA has answered a probe;
        return the one that was sent last. Raises AdapterError when the RCA is lost.
        """
        if self._failure:
            raise AdapterError(self._failure)
        sent = caps(self.profile.limits, None).clamp(velocity)
        now = time.monotonic()
        if sent == ZERO or self._gate.shut(now) or self._why_not_received():
            if sent == ZERO or self._gate.moving:
                self._send_zero(now)
            return ZERO
        self._gate.want(sent, now)
        self._probe_if_due(now)
        return self._gate.sent

    async def start(self, action: Action) -> None:
        """Start an action. After an ActionRefusedError the RCA has certainly not taken it, after
        another AdapterError it may have.
        """
        if self._failure:
            raise ActionRefusedError(ReasonCode.NOT_CONNECTED.of(self._failure))
        if isinstance(action, Tilt):
            check_tilt(self.profile, action)
            self._turn_head(action.angle)
            now, goal = time.monotonic(), (action.angle, action.angle)
            self.pending_actions.begin(
                PendingAction(action.action_id, "tilt", now, goal, now + LONGEST_TILT)
            )
            return
        name = str(type(action).__struct_config__.tag)
        if name not in self.profile.capabilities or not isinstance(
            action, Goto | Dock | Undock | Relocalize
        ):
            raise ActionRefusedError(ReasonCode.UNSUPPORTED)
        if isinstance(action, Relocalize):
            self.pending_actions.begin(await self._order(action))
            return
        await self._start_moving(action)

    async def _start_moving(self, action: Action) -> None:
        expected = self._pending(action)
        self.pending_actions.own(expected)
        try:
            pending = await self._order(action)
        except ActionRefusedError:
            self.pending_actions.disown(action.action_id)
            raise
        except BaseException as error:  # also when the caller has waited long enough
            expected.failure = ReasonCode.NOT_CONNECTED.of(str(error) or "no answer")
            raise
        if self.pending_actions.of(action.action_id) is not None:  # it has not ended in between
            pending.failure = expected.failure
            pending.first_cancelled_at = expected.first_cancelled_at
            self.pending_actions.begin(pending)

    async def cancel(self, action_id: str) -> bool:
        pending = self.pending_actions.of(action_id)
        if pending is None:
            return True
        if pending.kind == "tilt" and self.readings.tilt is not None:
            self._turn_head(self.readings.tilt)
        elif pending.drives and not await self._cancelled(pending):
            return False
        self.pending_actions.end(action_id, "CANCELLED", "cancelled")
        return True

    async def _cancelled(self, pending: PendingAction) -> bool:
        if self._failure:
            return False
        pending.cancelled_at = time.monotonic()
        if pending.first_cancelled_at is None:
            pending.first_cancelled_at = pending.cancelled_at
        try:
            return await self._withdraw(pending)
        except AdapterError as error:
            log.warning("cancel_failed", kind=pending.kind, reason=str(error))
            return False

    async def _cancel_again(self, pending: PendingAction) -> None:
        if await self._cancelled(pending):
            self.pending_actions.end(pending.action_id, "CANCELLED", "cancelled")

    async def _cancel_pending(self) -> None:
        """Send a cancel for an action that may still move the base; `_watch` repeats it."""
        drive = self.pending_actions.drive
        if drive is not None:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(CANCEL_TIME):
                    await self._cancel_again(drive)

    async def states(self) -> AsyncIterator[RcaState]:
        """Yield a state for each reading, and at 12 Hz without one. Raises AdapterError when the
        RCA is lost, or silent for a second.
        """
        while True:
            now = time.monotonic()
            if not self._failure and now - self.readings.last_received_at > SILENCE:
                self._lose(f"{self.place} has stopped sending {self.vital}")
            if not self._failure and self.must_answer and self._gate.unanswered(now) > SILENCE:
                self._lose(f"{self.place} no longer answers")
            if self._failure:
                self.pending_actions.end_all(ReasonCode.NOT_CONNECTED.of(self._failure))
                raise AdapterError(self._failure)
            yield self.readings.state(time.time())
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(PERIOD):
                    while not (self.readings.fresh or self._failure):
                        self._news.clear()
                        await self._news.wait()

    async def _watch(self) -> None:
        dock = DockState()
        while True:
            now = time.monotonic()
            if self._gate.moving and self._gate.shut(now):
                self._send_zero(now)
            self._look(now)
            readings = self.readings
            linear, angular = readings.velocity.linear, readings.velocity.angular
            reading = DockReading(
                at=now, contact=readings.charger_contact, linear=linear, angular=angular
            )
            dock = docked.follow(docked.DOCKED, dock, reading)
            self.pending_actions.watch(
                now, dock=dock, tilt=readings.tilt, pose=readings.pose, fixed_at=readings.fixed_at
            )
            drive = self.pending_actions.drive
            if drive and drive.failure and now - drive.cancelled_at > CANCEL_AGAIN:
                drive.cancelled_at = now
                self._run(self._cancel_again(drive))
            await asyncio.sleep(POLL_PERIOD)

    async def progress(self) -> AsyncIterator[ActionProgress]:
        while True:
            yield await self._progress.get()

    def video(self) -> VideoSource | None:
        return None

    def audio(self) -> AudioSource | None:
        return None

    def configure(self, config: Any) -> None:
        """Ignore a `Config`: nothing in it is the RCA's."""

    def sever(self) -> None:
        self._lose("the connection was cut on purpose")
        for task in self._tasks:
            task.cancel()

    async def close(self) -> None:
        """Cancel, brake, wait for the standstill, and disconnect."""
        if not self._failure:
            await self._cancel_pending()
            with contextlib.suppress(AdapterError, TimeoutError):
                await self._stand()
        await self._disconnect("closed")

    async def _stand(self) -> None:
        async with asyncio.timeout(BRAKING_TIME):
            while not self._failure:
                self._drive(ZERO)
                await asyncio.sleep(0.05)
                if is_within(self.readings.velocity, self.profile.standstill):
                    return

    async def _disconnect(self, why: str) -> None:
        self._failure = why
        self._news.set()
        await cancel(*self._tasks)
        await self._shut()
        is_lost = why != "closed"
        self.pending_actions.end_all(ReasonCode.NOT_CONNECTED if is_lost else ReasonCode.AGENT_ENDS)

    def _tell(self, progress: ActionProgress) -> None:
        self._progress.put(progress)
