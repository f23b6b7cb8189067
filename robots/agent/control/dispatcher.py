"""Connects every message that a robot receives to the safety kernel: one handler a message, all on
the control loop.

The dispatcher makes no safety decisions: it asks the kernel, sends its velocity and reports.
"""

import asyncio
import contextlib
import functools
from collections.abc import Callable, Coroutine, Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any

import msgspec
import structlog

from robots.agent.autonomy.area import dock_of
from robots.agent.control.actions import Actions
from robots.agent.control.calls import NOTHING, CallControl
from robots.agent.control.publisher import AgentLink, Media, Publisher
from robots.agent.control.remote_pointer import Pointing
from robots.agent.control.reports import Reports
from robots.agent.control.route_previews import RoutePreviews
from robots.agent.control.supervised_adapter import AdapterLink
from robots.agent.lab.in_force import CLEAN, Networks, in_force, is_held
from robots.agent.lab.timed import TimedLine
from robots.agent.media.webrtc.packet_gate import Command
from robots.agent.robot_interface import ActionProgress, RcaState
from robots.agent.safety.collision_monitor import CollisionMonitor, seen_from
from robots.agent.safety.contacts import SIDES, sides_of
from robots.agent.safety.freshness import frame_age
from robots.agent.safety.kernel import Kernel
from robots.agent.safety.obstacle_sources import NO_POINTS
from robots.agent.safety.permissions import CommandSender
from robots.agent.store import Store
from robots.agent.timing import Cadence, TimeSource
from robots.api import codec
from robots.api.floorplan import ChargingDock as Station
from robots.api.idle import INTEREST_SECONDS, WATCHER
from robots.api.messages import (
    Action,
    AppliedCommand,
    AssistLevel,
    Bye,
    Candidate,
    CommandHeartbeat,
    Config,
    FloorPlanUpdate,
    Lease,
    PictureRequest,
    PointCommand,
    Pointer,
    Role,
    RouteRequest,
    SdpOffer,
    Signal,
    Stay,
    Velocity,
    VelocityCommand,
)
from robots.api.reasons import ReasonCode

log = structlog.stdlib.get_logger(__name__)

HEARTBEAT_PERIOD = 0.2
DISK_PERIOD = 5.0
DriversMessage = VelocityCommand | Action | RouteRequest


class CommandDispatcher:
    """The handlers. `spawn` runs a coroutine in the background."""

    def __init__(
        self,
        kernel: Kernel,
        adapter: AdapterLink,
        link: AgentLink,
        media: Media,
        store: Store,
        *,
        times: TimeSource,
        boot: str,
        spawn: Callable[[Coroutine[Any, Any, None]], None],
        networks: Networks = CLEAN,
        monitor: CollisionMonitor | None = None,
    ) -> None:
        self._kernel, self._adapter, self._media, self._store = kernel, adapter, media, store
        self._times, self._spawn, self._monitor = times, spawn, monitor
        self._needed_until = times.now() + INTEREST_SECONDS
        self.out = Publisher(link, media, self.is_needed)
        self._calls, self._passing, self._pointing = CallControl(), NOTHING, Pointing()
        self._own_networks, self._networks = networks, CLEAN
        self._line: TimedLine | None = None
        self.reports = Reports(
            boot,
            kernel,
            self.out.send,
            media,
            times,
            calls=self._calls,
            control_network=lambda: self._line.report() if self._line is not None else None,
            is_needed=self.is_needed,
        )
        self.actions = Actions(
            kernel,
            adapter,
            self.reports,
            self.out,
            latch_changed=self._keep_latch,
            send_velocity=self.send_velocity,
            spawn=spawn,
            times=times,
            calls=self._calls,
            media=media,
        )
        self._routes = RoutePreviews(adapter, self.out.send, times, spawn)
        self._heartbeat_due, self._disk_due = Cadence(HEARTBEAT_PERIOD), Cadence(DISK_PERIOD)
        self._unreported: AppliedCommand | None = None  # its velocity has not been sent yet
        self._is_checking_disk = False
        self._dock: Station | None = None  # this robot's own, on the server's map
        self._writing = asyncio.Lock()  # one write at a time
        self._stored_latch = kernel.latch
        self._faults: dict[str, str] = {}
        self._config: Config | None = None
        self._was_up = False
        self._set_fault(ReasonCode.ADAPTER_STARTING, "the agent is connecting to the robot")

    # --- from the broker (LinkInbox) --------------------------------------------------------------

    def arrived(self, suffix: str, message: Any, *, retained: bool) -> None:
        """Take a message of the server."""
        with self._brake_on_error(suffix):
            if not retained and _shows_need(message):
                self._attract()
            self._arrived(suffix, message, retained=retained)

    def _arrived(self, suffix: str, message: Any, *, retained: bool) -> None:
        sender = CommandSender("mqtt", retained=retained)
        match message:
            case VelocityCommand() | Action() | RouteRequest():
                self._deliver(message, sender)
            case CommandHeartbeat(peer=peer) if not retained and peer != WATCHER:
                self._heartbeat(peer, message, sender)
            case Lease():
                self._lease(message, retained=retained)
            case SdpOffer() | Candidate() | Bye() | Stay():
                self._signal(suffix, message, retained=retained)
            case PictureRequest() if not retained:
                self._media.picture_wanted(message)
            case PointCommand(peer=peer) if not retained:
                self._point(peer, message, sender)
            case Config():
                self._configure(message)
            case FloorPlanUpdate():
                log.info("floorplan_received", map=message.map_id, sha256=message.sha256)
                self._adapter.take_floorplan(message)
                self._dock = dock_of(message, self._adapter.adapter.profile.series)
            case None if suffix == "lease":
                self._lease(None, retained=retained)

    @contextlib.contextmanager
    def _brake_on_error(self, suffix: str) -> Iterator[None]:
        """Brake for a message whose handling failed, and continue: the next one may be a stop."""
        try:
            yield
        except Exception:
            log.exception("message_failed", suffix=suffix)
            self.rejected("failed")
            self._kernel.brake(self._times.now())

    def rejected(self, reason: str, count: int = 1) -> None:
        """Count messages that could not be decoded."""
        self._kernel.refused[reason] += count

    def link_changed(self, *, up: bool) -> None:
        """Note the state of the broker link. A lost link does not stop a drive; the lease's expiry
        does.
        """
        log.info("link_changed", up=up)
        if up:
            self.reports.republish()

    def is_needed(self) -> bool:
        """Tell whether the robot reports at its full rate (robots/api/idle.py). It does so for
        INTEREST_SECONDS after its start and after the last need, so that the end of a drive is
        seen.
        """
        kernel, now = self._kernel, self._times.now()
        if (
            kernel.leases.announced(now) is not None
            or self._media.connected > 0
            or kernel.navigation is not None
            or self.reports.is_moving
        ):
            self._needed_until = now + INTEREST_SECONDS
        return now < self._needed_until

    def rival(self, boot: str | None) -> None:
        """Yield to another, newer agent of this robot: two agents on one base cannot be safe."""
        self._kernel.yields = boot is not None
        if boot is None:
            self._clear_fault(ReasonCode.RIVAL)
        else:
            log.error("rival_agent", boot=boot, to_do="end one of the two agents of this robot")
            self._set_fault(
                ReasonCode.RIVAL, "another agent runs as this robot; end one of the two"
            )

    # --- from the data channels -------------------------------------------------------------------

    def take_commands(
        self, commands: Iterable[tuple[str, Role, Command]], rejected: Mapping[str, int]
    ) -> None:
        """Take commands of all pages; the lease decides which of them drives."""
        for reason, count in rejected.items():
            self.rejected(reason, count)
        for peer, role, command in commands:
            with self._brake_on_error("data channel"):
                self._take_command(peer, role, command)

    def _take_command(self, peer: str, role: Role, command: Command) -> None:
        sender = CommandSender("datachannel", peer, role=role)
        match command:
            case CommandHeartbeat():
                self._heartbeat(peer, command, sender)
            case PointCommand():
                self._point(peer, command, sender)
            case _:
                self._deliver(command, sender)

    # --- from the adapter (AdapterListener) -------------------------------------------------------

    def reading(self, reading: RcaState) -> None:
        """Take a reading of the RCA and report what has changed."""
        before, was_docked = self.reports.reading, self.reports.docked
        if reading.is_measured:
            self._kernel.measured(reading.velocity, self._times.now())
            if self.actions.safety_test is not None:
                self.actions.safety_test.measured(reading.velocity.linear, self._times.now())
        if reading.estop is not None and self._kernel.button(
            pressed=reading.estop, now=self._times.now(), unix=self._times.unix()
        ):
            self.send_velocity()
            self.actions.button_pressed()
        reading = self._perceived(reading)
        self._kernel.assist.clearance = reading.clearance
        self.reports.take(reading)
        if before.stamp > 0.0:
            self._report_changes(before, reading)
            if self.reports.docked != was_docked:
                self.reports.event("docked" if self.reports.docked else "undocked")

    def _perceived(self, reading: RcaState) -> RcaState:
        """Return a reading with what the collision monitor and the agent's own navigation add."""
        monitor, now = self._monitor, self._times.now()
        if monitor is None:
            return self._adapter.located(reading, NO_POINTS)
        monitor.sense(reading, now)
        reading = self._adapter.located(reading, monitor.points())
        monitor.dock = seen_from(reading.pose, self._adapter.dock or self._dock)
        if reading.clearance is None:
            reading = replace(reading, clearance=monitor.clearance())
        if self._kernel.monitor is None:
            return reading
        why, point = monitor.why(now)
        return replace(reading, assist_why=why, assist_point=point)

    def progressed(self, progress: ActionProgress) -> None:
        self.actions.progressed(progress)

    def adapter_changed(self, *, up: bool, reason: str = "") -> None:
        if not up:
            if ReasonCode.ADAPTER_LOST not in self._faults and self._was_up:
                self.reports.event("adapter_lost", detail=reason)
            self._set_fault(ReasonCode.ADAPTER_LOST, reason)
            self.actions.cancel_all()
        self._clear_fault(ReasonCode.ADAPTER_STARTING)
        if up:
            self.reports.connected()
            self._clear_fault(ReasonCode.ADAPTER_LOST)
            if self._config is not None:
                self._adapter.configure(self._config)
            if self._was_up:
                self.reports.event("adapter_back")
            self._was_up = True

    # --- time -------------------------------------------------------------------------------------

    def tick(self) -> None:
        """Run the work of one tick, 50 times a second: velocities first, then reports."""
        self.send_velocity()
        self._lapse()
        self._report_applied()
        self.actions.tick()
        self._drive_safety_test()
        self._adapter.set_lock(locked=self._kernel.is_stopped)
        if self._kernel.navigation:
            self._adapter.limit_speed(self._kernel.caps(self._times.now()).linear)
        self._check_standstill()
        self._update_call()
        if self._heartbeat_due.due(self._times.now()):
            self._beat()
        if self._disk_due.due(self._times.now()) and not self._is_checking_disk:
            self._is_checking_disk = True
            self._spawn(self._check_disk())
        self.reports.tick()

    def _drive_safety_test(self) -> None:
        """Take the messages of the test's driver as if the broker had delivered them. A cancelled
        test only gets its last stop.
        """
        run = self.actions.safety_test
        if run is None:
            return
        if not self.actions.runs(run.action.action_id):
            run.fail("cancelled")
        for message in run.messages(self._times.now(), self._times.unix()):
            is_velocity = isinstance(message, VelocityCommand)
            suffix = "command/velocity" if is_velocity else "command/action"
            self.arrived(suffix, message, retained=False)
        self.actions.end_safety_test()

    def deadline(self) -> float | None:
        return self._kernel.deadline()

    def send_velocity(self) -> None:
        """Send the kernel's decision to the base."""
        wanted = self._adapter.wanted() if self._kernel.navigation else None
        decision = self._kernel.tick(self._times.now(), wanted)
        for action_id, reason in self._kernel.drain_cancelled():
            self.actions.cancelled(action_id, reason)
        if decision.velocity is None:
            return
        applied = self._adapter.apply(decision.velocity)
        if applied is not None:
            self._kernel.applied(applied)

    def brake(self) -> None:
        """Stop for good before the agent ends."""
        self._set_fault(ReasonCode.CLOSING, "the agent ends")

    @property
    def is_at_rest(self) -> bool:
        """Tell whether the robot is at rest and every action has ended, or the RCA is lost."""
        kernel = self._kernel
        return not self._adapter.up or (kernel.is_at_rest and not kernel.is_end_unconfirmed)

    # --- handlers ---------------------------------------------------------------------------------

    def _deliver(self, message: DriversMessage, sender: CommandSender) -> None:
        """Handle a command at once, or after the delay of the network that a study emulates."""
        if self._line is not None and is_held(message, sender, self._driver()):
            command = functools.partial(self._delayed, message, sender)
            self._line.offer(len(codec.encode(message)), command)
        else:
            self._command(message, sender)

    def _delayed(self, message: DriversMessage, sender: CommandSender) -> None:
        with self._brake_on_error("network lab"):
            self._command(message, sender)

    def _command(self, message: DriversMessage, sender: CommandSender) -> None:
        if isinstance(message, VelocityCommand):
            self._velocity(message, sender)
        elif isinstance(message, RouteRequest):
            if not sender.retained:
                self._routes.take(message, sender, self._driver())
        else:
            self.actions.take(message, sender)

    def _velocity(self, command: VelocityCommand, sender: CommandSender) -> None:
        """Send an accepted velocity at once, not at the next tick, and report what was applied.

        Two commands can arrive between two ticks, so the earlier one is reported before the later
        one replaces it. If the adapter holds the velocity back, the report waits for the next tick.
        """
        verdict = self._kernel.velocity(
            command, sender, now=self._times.now(), unix=self._times.unix()
        )
        if verdict.reason is not None:
            return
        self.send_velocity()
        self._report_applied()
        self._unreported = AppliedCommand(
            seq=command.seq,
            stamp=command.stamp,
            method=command.method,
            way=sender.transport,
            age=verdict.age,
            linear=0.0,
            angular=0.0,
            frame_age=frame_age(command, self._times.unix()),
            asked=Velocity(linear=command.linear, angular=command.angular),
            allowed=verdict.allowed,
            share=verdict.share,
        )
        if not self._kernel.is_waiting:
            self._report_applied()

    def _report_applied(self) -> None:
        """Report the newest command with the velocity that was really sent. Where the adapter holds
        a velocity back, it is known at the next tick.
        """
        applied, sent = self._unreported, self._kernel.commanded
        self._unreported = None
        if applied is not None:
            self.reports.applied(
                msgspec.structs.replace(applied, linear=sent.linear, angular=sent.angular)
            )

    def _attract(self) -> None:
        """Note that the robot is needed; an idle one reports at once."""
        was_idle = not self.is_needed()
        self._needed_until = self._times.now() + INTEREST_SECONDS
        if was_idle:
            self.reports.state()
            self._beat()

    def _beat(self) -> None:
        now, kernel = self._times.now(), self._kernel
        lease = kernel.leases.announced(now)
        peers = (lease.peer, lease.wizard or lease.peer) if lease else ()
        beat = kernel.clocks.beat(now, self._times.unix(), first=peers)
        self.out.send("heartbeat", beat)
        if self.actions.safety_test is not None:
            answer = self.actions.safety_test.answer(beat, self._times.unix())
            self.arrived("command/heartbeat", answer, retained=False)

    def _heartbeat(self, peer: str, beat: CommandHeartbeat, sender: CommandSender) -> None:
        now = self._times.now()
        self._kernel.clocks.on_heartbeat(
            peer, sender.transport, beat, now=now, unix=self._times.unix()
        )
        self._kernel.heartbeat(peer, sender.transport, now)

    def _point(self, peer: str, command: PointCommand, sender: CommandSender) -> None:
        lease, now = self._driver(), self._times.now()
        by = self._pointing.take(
            peer, command, sender, lease, shown=self._calls.shows_screen(lease, now), now=now
        )
        if by is not None:
            self.out.point(Pointer(stamp=self._times.unix(), by=by, at=command.at))

    def _lease(self, lease: Lease | None, *, retained: bool) -> None:
        """Take a lease of the server; an outdated one changes nothing.

        Two leases matter: the announced one, to whose session states belong, may be a stored copy
        that permits nothing; the live one permits driving. If the driver has changed, the target is
        void, and the velocity that is sent first begins to brake. The grant is stored on the disk
        in the background, so that an older one cannot return after a restart of the agent.
        """
        kernel, now = self._kernel, self._times.now()
        announced, driver = kernel.leases.announced(now), kernel.leases.live(now)
        newest = kernel.leases.newest
        if not kernel.take_lease(lease, retained=retained, now=now):
            log.info(
                "lease_ignored",
                epoch=lease.epoch if lease else None,
                renewal=lease.renewal if lease else None,
            )
            return
        self.send_velocity()
        self._set_assist()
        after = kernel.leases.announced(now)
        if announced is not None and (after is None or after.session != announced.session):
            self._close_session(announced)
        self._driver_changed(driver, kernel.leases.live(now))
        self._set_networks()
        if kernel.leases.newest is not None and (
            newest is None or newest.epoch != kernel.leases.newest.epoch
        ):
            self._spawn(self._keep_lease())

    def _driver_changed(self, before: Lease | None, after: Lease | None) -> None:
        if after is not None and (
            before is None or (before.session, before.epoch) != (after.session, after.epoch)
        ):
            log.info("lease_taken", session=after.session, epoch=after.epoch, peer=after.peer)
            self.reports.event("lease_taken", detail=after.who)
        peer = after.peer if after else None
        if peer != (before.peer if before else None):
            self._media.lease_changed(peer)

    def _lapse(self) -> None:
        lapsed = self._kernel.leases.lapse(self._times.now())
        if lapsed is not None:
            log.warning("lease_expired", session=lapsed.session, epoch=lapsed.epoch)
            self.reports.event("lease_expired", lapsed)
            self._close_session(lapsed)
            self._media.lease_changed(None)
            self._set_assist()
            self._set_networks()

    def _driver(self) -> Lease | None:
        return self._kernel.leases.live(self._times.now())

    def _check_standstill(self) -> None:
        """Report a robot that moves although it must be at rest, or is never measured at rest."""
        kernel, now = self._kernel, self._times.now()
        up = self._adapter.up
        runs_on = "the robot keeps moving although it was told to stop"
        self._report(ReasonCode.RUNS_ON, runs_on, holds=up and kernel.moves_despite_stop(now))
        settling = "the robot is never measured at rest; set its standstill thresholds"
        self._report(ReasonCode.SETTLING, settling, holds=up and kernel.settles_too_long(now))

    def _report(self, name: ReasonCode, text: str, *, holds: bool) -> None:
        """Report an error for as long as it holds, at once when it starts."""
        if not holds:
            self.reports.errors.pop(name, None)
        elif name not in self.reports.errors:
            log.error(name, velocity=self.reports.reading.velocity)
            self.reports.errors[name] = name.of(text)
            self.reports.send_soon()

    def _update_call(self) -> None:
        """Tell the media side when the let-through media of the driver have changed."""
        passing = self._calls.passing(self._driver(), self._times.now())
        if passing != self._passing:
            self._passing = passing
            log.info("visitor_media", audio=passing.audio, video=passing.video)
            self._media.let_through(audio=passing.audio, video=passing.video, volume=passing.volume)

    def _close_session(self, lease: Lease) -> None:
        """Send the last state of a session and close it."""
        self._report_applied()
        last = self.reports.state(lease)
        self.reports.event("session_closed", lease, last_seq=last)

    def _signal(self, suffix: str, message: Signal, *, retained: bool) -> None:
        if retained:
            self.rejected("retained")
            return
        self._media.signal(suffix.split("/")[1], message)

    def _configure(self, config: Config) -> None:
        before, self._config = self._config, config
        self._calls.rule = config.calls
        self._set_assist()
        self._set_networks()
        self._adapter.configure(config)
        for door, state in config.doors.items():
            if before is not None and before.doors.get(door) != state:
                self.reports.event("door_changed", detail=f"{door} {state}")

    def _set_assist(self) -> None:
        lease = self._kernel.leases.announced(self._times.now())
        level: AssistLevel = self._config.assist if self._config else "off"
        if lease is not None and lease.assist is not None:
            level = lease.assist
        # a robot without a sensor for obstacles cannot steer around them, so it is slowed down
        if level == "steer" and "assist" not in self._kernel.capabilities:
            level = "slow"
        self._kernel.assist.level = level

    def _set_networks(self) -> None:
        """Apply the network emulated for the driver. What the old one still holds is lost."""
        networks = in_force(self._driver(), self._config, self._own_networks)
        if networks == self._networks:
            return
        self._networks = networks
        log.info(
            "network_lab", session=networks.session, control=networks.control, video=networks.video
        )
        if self._line is not None:
            self._line.close()
        control = networks.control
        self._line = None if control is None else TimedLine(control, self._times.now)
        self._media.impair(networks.video)

    def _report_changes(self, before: RcaState, after: RcaState) -> None:
        if after.battery.charging and not before.battery.charging:
            self.reports.event("charging")
        self._handle_contacts(before, after)
        if (localized := after.pose.localized) != before.pose.localized:
            self.reports.event("localization_found" if localized else "localization_lost")

    def _handle_contacts(self, before: RcaState, after: RcaState) -> None:
        """Stop for a new contact, and allow no motion towards one that lasts."""
        felt = sides_of(after.bumper or ())
        if after.contacts > before.contacts or felt - sides_of(before.bumper or ()):
            self._kernel.touched(felt)
            self.send_velocity()
            self.reports.event("collision", detail=" ".join(side for side in SIDES if side in felt))
        self._kernel.contacts.felt(felt)

    # --- faults and storage -----------------------------------------------------------------------

    def _set_fault(self, name: ReasonCode, text: str) -> None:
        self._faults[name] = text
        self.reports.errors[name] = name.of(text)[:300]
        self._kernel.set_fault(name)
        self.send_velocity()

    def _clear_fault(self, name: str) -> None:
        if self._faults.pop(name, None) is None:
            return
        self.reports.errors.pop(name, None)
        if not self._faults:
            self._kernel.clear_fault(self._times.now())

    async def _check_disk(self) -> None:
        try:
            self.reports.shortage = await asyncio.to_thread(self._store.shortage)
        finally:
            self._is_checking_disk = False

    async def _keep_latch(self) -> None:
        async with self._writing:
            latch = self._kernel.latch
            if latch == self._stored_latch:
                return
            if await self._write(lambda: self._store.keep_latch(latch)):
                self._stored_latch = latch

    async def _keep_lease(self) -> None:
        async with self._writing:
            newest = self._kernel.leases.newest
            if newest is not None:
                await self._write(lambda: self._store.keep_lease(newest))

    async def _write(self, write: Callable[[], None]) -> bool:
        """Write in a thread; report a failure, such as a full disk, and return whether it
        succeeded.
        """
        try:
            await asyncio.to_thread(write)
        except OSError as error:
            log.exception("store_failed")
            self.reports.errors[ReasonCode.STORE] = ReasonCode.STORE.of(error.strerror or error)[
                :300
            ]
            return False
        self.reports.errors.pop(ReasonCode.STORE, None)
        return True


def _shows_need(message: Any) -> bool:
    """Tell whether a message of the server shows that the robot is needed."""
    match message:
        case VelocityCommand() | Action() | Lease() | PictureRequest():
            return True
        case CommandHeartbeat():
            return message.needed
    return False
