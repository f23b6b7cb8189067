"""Where everything that a robot hears meets the safety kernel: one handler a message, all of them
on the control loop.

The dispatcher decides nothing that matters for safety: it asks the kernel, tells the wheels, and
reports.
"""

import asyncio
import contextlib
import functools
from collections.abc import Callable, Coroutine, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import msgspec
import structlog

from robots.agent.autonomy.area import dock_of
from robots.agent.control.actions import Actions
from robots.agent.control.attention import Attention, Needs
from robots.agent.control.calls import NOTHING, CallControl
from robots.agent.control.publisher import AgentLink, Media, Publisher
from robots.agent.control.remote_pointer import Pointing
from robots.agent.control.reports import Reports
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
from robots.api.idle import WATCHER
from robots.api.messages import (
    Action,
    AppliedCommand,
    AssistLevel,
    Bye,
    Candidate,
    CommandHeartbeat,
    Config,
    FloorPlanUpdate,
    LabReport,
    Lease,
    PictureRequest,
    PointCommand,
    Pointer,
    Role,
    SdpOffer,
    Signal,
    Stay,
    Velocity,
    VelocityCommand,
)

log = structlog.stdlib.get_logger(__name__)

HEARTBEAT_PERIOD = 0.2
DISK_PERIOD = 5.0
ADAPTER_LOST, ADAPTER_STARTING = "adapter_lost", "adapter_starting"
RIVAL = "rival"
CLOSING = "closing"
STORE = "store"
RUNS_ON, SETTLING = "runs_on", "settling"


@dataclass(frozen=True)
class DispatcherParts:
    """What a dispatcher is made of."""

    kernel: Kernel
    adapter: AdapterLink
    link: AgentLink
    media: Media
    store: Store
    times: TimeSource
    boot: str
    networks: Networks = CLEAN
    monitor: CollisionMonitor | None = None


class CommandDispatcher:
    """The handlers. `spawn` runs a coroutine beside the loop."""

    def __init__(
        self, parts: DispatcherParts, spawn: Callable[[Coroutine[Any, Any, None]], None]
    ) -> None:
        self._kernel, self._adapter = parts.kernel, parts.adapter
        self._media, self._monitor = parts.media, parts.monitor
        self._store, self._times, self._spawn = parts.store, parts.times, spawn
        self._attention = Attention(
            Needs(
                has_lease=lambda: parts.kernel.leases.announced(parts.times.now()) is not None,
                moves=lambda: parts.kernel.navigation is not None or self.reports.is_moving,
                pages=lambda: parts.media.connected,
            ),
            parts.times.now(),
        )
        self.out = Publisher(parts.link, parts.media, self.is_needed)
        self._calls, self._passing, self._pointing = CallControl(), NOTHING, Pointing()
        self._own_networks, self._networks = parts.networks, CLEAN
        self._line: TimedLine | None = None
        self.reports = Reports(
            parts.boot,
            parts.kernel,
            self.out.send,
            lambda: parts.media.connected,
            parts.times,
            screens=lambda: parts.media.screens,
            call=lambda: self._calls.state(self._driver(), self._times.now()),
            knock=lambda: (
                self._calls.knockable(self._driver(), audible=parts.media.audible),
                self._calls.knocking(self._driver(), self._times.now()),
            ),
            networks=self._networks_told,
            devices=lambda: (parts.media.camera_status, (*parts.media.errors, *self._shortage)),
            is_needed=self.is_needed,
        )
        self.actions = Actions(
            parts.kernel,
            parts.adapter,
            self.reports,
            self.out,
            snapshot=parts.media.snapshot,
            latch_changed=self._keep_latch,
            turn_wheels=self.turn_wheels,
            spawn=spawn,
            times=parts.times,
            calls=self._calls,
            media=parts.media,
        )
        self._heartbeat_due = Cadence(HEARTBEAT_PERIOD)
        self._disk_due = Cadence(DISK_PERIOD)
        self._shortage: tuple[str, ...] = ()
        self._unreported: AppliedCommand | None = None  # its velocity has not been sent yet
        self._looks_at_disk = False
        self._dock: Station | None = None  # this robot's own, on the server's map
        self._writing = asyncio.Lock()  # one after the other
        self._kept_latch = parts.kernel.latch  # as the disk has it
        self._faults: dict[str, str] = {}
        self._config: Config | None = None
        self._was_up = False
        self._set_fault(ADAPTER_STARTING, "the agent is connecting to the robot")

    # --- from the broker (mqtt.Inbox) -------------------------------------------------------------

    def arrived(self, suffix: str, message: Any, *, retained: bool) -> None:
        """Take a message of the server."""
        with self._surviving(suffix):
            if not retained and _shows_need(message):
                self._attract()
            self._arrived(suffix, message, retained=retained)

    def _arrived(self, suffix: str, message: Any, *, retained: bool) -> None:
        sender = CommandSender("mqtt", retained=retained)
        match message:
            case VelocityCommand() | Action():
                self._travel(message, sender)
            case CommandHeartbeat(peer=peer) if not retained and peer != WATCHER:
                self._heartbeat(peer, message, sender)
            case Lease():
                self._lease(message, retained=retained)
            case SdpOffer() | Candidate() | Bye() | Stay():
                self._signal(suffix, message, retained=retained)
            case PictureRequest() if not retained:
                self._media.picture_wanted(message)
            case PointCommand() if not retained:
                self._point(message.peer, message, sender)
            case Config():
                self._configure(message)
            case FloorPlanUpdate():
                log.info("floorplan_received", map=message.map_id, sha256=message.sha256)
                self._adapter.take_floorplan(message)
                self._dock = dock_of(message, self._adapter.adapter.profile.series)
            case None if suffix == "lease":
                self._lease(None, retained=retained)

    @contextlib.contextmanager
    def _surviving(self, suffix: str) -> Iterator[None]:
        """Brake for a message that could not be dealt with, whichever way it came, and go on: the
        next one may be a stop.
        """
        try:
            yield
        except Exception:
            log.exception("message_failed", suffix=suffix)
            self.rejected("failed")
            self._kernel.brake(self._times.now())

    def rejected(self, reason: str, count: int = 1) -> None:
        """Count what could not be decoded."""
        self._kernel.refused[reason] += count

    def link_changed(self, *, up: bool) -> None:
        """The broker was reached, or lost: neither stops a drive, the lease's own time does."""
        log.info("link_changed", up=up)
        if up:
            self.reports.say_again()

    def is_needed(self) -> bool:
        """Tell whether somebody drives, watches or is about to."""
        return self._attention.is_needed(self._times.now())

    def rival(self, boot: str | None) -> None:
        """Another, newer agent is this robot: yield to it, for two of them on one base cannot be
        safe.
        """
        self._kernel.yields = boot is not None
        if boot is None:
            self._clear_fault(RIVAL)
        else:
            log.error("rival_agent", boot=boot, to_do="end one of the two agents of this robot")
            self._set_fault(RIVAL, "another agent runs as this robot; end one of the two")

    # --- from the data channels -------------------------------------------------------------------

    def heard(self, said: Iterable[tuple[str, Role, Command]], rejected: Mapping[str, int]) -> None:
        """Take what pages have said. Who may drive is said by the lease, so every peer's commands
        come here.
        """
        for reason, count in rejected.items():
            self.rejected(reason, count)
        for peer, role, command in said:
            with self._surviving("data channel"):
                self._heard(peer, role, command)

    def _heard(self, peer: str, role: Role, command: Command) -> None:
        sender = CommandSender("datachannel", peer, role=role)
        match command:
            case CommandHeartbeat():
                self._heartbeat(peer, command, sender)
            case PointCommand():
                self._point(peer, command, sender)
            case _:
                self._travel(command, sender)

    # --- from the adapter (adapter_link.Listener) -------------------------------------------------

    def reading(self, reading: RcaState) -> None:
        """Take what the RCA reports, and say what has changed."""
        before, was_docked = self.reports.reading, self.reports.docked
        if reading.is_measured:
            self._kernel.measured(reading.velocity, self._times.now())
        if reading.estop is not None and self._kernel.button(
            pressed=reading.estop, now=self._times.now(), unix=self._times.unix()
        ):
            self.turn_wheels()
            self.actions.button_pressed()
        reading = self._perceived(reading)
        self._kernel.assist.clearance = reading.clearance
        self.reports.take(reading)
        if before.stamp > 0.0:
            self._say_changes(before, reading)
            if self.reports.docked != was_docked:
                self.reports.event("docked" if self.reports.docked else "undocked")

    def _perceived(self, reading: RcaState) -> RcaState:
        """Return a reading with what the collision monitor and the agent's own navigation make of
        it.
        """
        monitor, now = self._monitor, self._times.now()
        if monitor is None:
            return self._adapter.located(reading, NO_POINTS)
        monitor.sense(reading, now)
        reading = self._adapter.located(reading, monitor.points())
        monitor.dock = seen_from(reading.pose, self._adapter.dock or self._dock)
        reading = replace(
            reading,
            clearance=monitor.clearance() if reading.clearance is None else reading.clearance,
        )
        if self._kernel.monitor is None:
            return reading
        why, point = monitor.why(now)
        return replace(reading, assist_why=why, assist_point=point)

    def progressed(self, progress: ActionProgress) -> None:
        """Take news of an action."""
        self.actions.progressed(progress)

    def adapter_changed(self, *, up: bool, reason: str = "") -> None:
        """The RCA was reached, or lost."""
        if not up:
            if ADAPTER_LOST not in self._faults and self._was_up:
                self.reports.event("adapter_lost", detail=reason)
            self._set_fault(ADAPTER_LOST, reason)
            self.actions.cancel_all()
        self._clear_fault(ADAPTER_STARTING)
        if up:
            self.reports.connected()
            self._clear_fault(ADAPTER_LOST)
            if self._config is not None:
                self._adapter.configure(self._config)
            if self._was_up:
                self.reports.event("adapter_back")
            self._was_up = True

    # --- time -------------------------------------------------------------------------------------

    def tick(self) -> None:
        """Fifty times a second: the lease's end, the wheels, and what is due to be said."""
        self._lapse()
        self.turn_wheels()
        self._report_applied()
        self.actions.tick()
        self._adapter.set_lock(locked=self._kernel.is_stopped)
        if self._kernel.navigation:
            self._adapter.limit_speed(self._kernel.caps(self._times.now()).linear)
        self._look_after_standstill()
        self._look_after_call()
        if self._heartbeat_due.due(self._times.now()):
            self._beat()
        if self._disk_due.due(self._times.now()) and not self._looks_at_disk:
            self._looks_at_disk = True
            self._spawn(self._look_at_disk())
        self.reports.tick()

    def deadline(self) -> float | None:
        """Return the moment of the deadman, when that is sooner than the next tick may be."""
        return self._kernel.deadline()

    def turn_wheels(self) -> None:
        """Let the kernel's decision reach the base."""
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
        """The agent is about to end: from now on nothing moves the robot."""
        self._set_fault(CLOSING, "the agent ends")

    @property
    def is_at_rest(self) -> bool:
        """Tell whether the robot is at rest and every action has ended, or cannot be reached."""
        kernel = self._kernel
        return not self._adapter.up or (kernel.is_at_rest and not kernel.is_end_unconfirmed)

    # --- handlers ---------------------------------------------------------------------------------

    def _travel(self, message: VelocityCommand | Action, sender: CommandSender) -> None:
        """Take a command at once, or when the network that a study has put on its driver's commands
        lets it through.
        """
        if self._line is not None and is_held(message, sender, self._driver()):
            self._line.offer(
                len(codec.encode(message)), functools.partial(self._delayed, message, sender)
            )
        else:
            self._command(message, sender)

    def _delayed(self, message: VelocityCommand | Action, sender: CommandSender) -> None:
        """Take a command that the network lab has held, outside of the message that brought it."""
        with self._surviving("network lab"):
            self._command(message, sender)

    def _command(self, message: VelocityCommand | Action, sender: CommandSender) -> None:
        if isinstance(message, VelocityCommand):
            self._velocity(message, sender)
        else:
            self.actions.take(message, sender)

    def _velocity(self, command: VelocityCommand, sender: CommandSender) -> None:
        verdict = self._kernel.velocity(
            command, sender, now=self._times.now(), unix=self._times.unix()
        )
        if verdict.reason is not None:
            return
        self.turn_wheels()
        self._report_applied()
        applied = AppliedCommand(
            seq=command.seq,
            stamp=command.stamp,
            method=command.method,
            way=sender.way,
            age=verdict.age,
            linear=0.0,
            angular=0.0,
            frame_age=frame_age(command, self._times.unix()),
            asked=Velocity(linear=command.linear, angular=command.angular),
            allowed=verdict.allowed,
            share=verdict.share,
        )
        self._unreported = applied
        if not self._kernel.is_waiting:
            self._report_applied()

    def _report_applied(self) -> None:
        """Report the newest command with the velocity that the base was really sent. Where the
        adapter holds a velocity back, that is known at the next tick.
        """
        applied, sent = self._unreported, self._kernel.commanded
        self._unreported = None
        if applied is not None:
            self.reports.applied(
                msgspec.structs.replace(applied, linear=sent.linear, angular=sent.angular)
            )

    def _attract(self) -> None:
        """Note that somebody needs the robot; one that was idle speaks at once."""
        if self._attention.attract(self._times.now()):
            self.reports.state()
            self._beat()

    def _beat(self) -> None:
        now, kernel = self._times.now(), self._kernel
        lease = kernel.leases.announced(now)
        peers = (lease.peer, lease.wizard or lease.peer) if lease else ()
        self.out.send("heartbeat", kernel.clocks.beat(now, self._times.unix(), first=peers))

    def _heartbeat(self, peer: str, beat: CommandHeartbeat, sender: CommandSender) -> None:
        now = self._times.now()
        self._kernel.clocks.heard(peer, sender.way, beat, now=now, unix=self._times.unix())
        self._kernel.heartbeat(peer, sender.way, now)

    def _point(self, peer: str, command: PointCommand, sender: CommandSender) -> None:
        """Pass on where one side points; neither the kernel nor the record has to do with it."""
        lease, now = self._driver(), self._times.now()
        by = self._pointing.take(
            peer, command, sender, lease, shown=self._calls.shows_screen(lease, now), now=now
        )
        if by is not None:
            self.out.point(Pointer(stamp=self._times.unix(), by=by, at=command.at))

    def _lease(self, lease: Lease | None, *, retained: bool) -> None:
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
        self.turn_wheels()
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

    def _look_after_standstill(self) -> None:
        """Report a robot that moves although it has to be at rest, or is never measured so."""
        kernel, now = self._kernel, self._times.now()
        self._report(
            RUNS_ON,
            "the robot keeps moving although it was told to stop",
            holds=self._adapter.up and kernel.moves_despite_stop(now),
        )
        self._report(
            SETTLING,
            "the robot is never measured at rest; set its standstill thresholds",
            holds=self._adapter.up and kernel.settles_too_long(now),
        )

    def _report(self, name: str, text: str, *, holds: bool) -> None:
        """Report an error for as long as it holds, at once when it begins."""
        if not holds:
            self.reports.errors.pop(name, None)
        elif name not in self.reports.errors:
            log.error(name, velocity=self.reports.reading.velocity)
            self.reports.errors[name] = f"{name}: {text}"
            self.reports.hurry()

    def _look_after_call(self) -> None:
        """Tell the media side, when it has changed, what of the driver's voice and face is let
        through.
        """
        passing = self._calls.passing(self._driver(), self._times.now())
        if passing != self._passing:
            self._passing = passing
            log.info("visitor_media", audio=passing.audio, video=passing.video)
            self._media.let_through(audio=passing.audio, video=passing.video, volume=passing.volume)

    def _close_session(self, lease: Lease) -> None:
        """Say the last state of a session, and that it was the last."""
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
        asked: AssistLevel = self._config.assist if self._config else "off"
        if lease is not None and lease.assist is not None:
            asked = lease.assist
        # Steering needs to see obstacles; a robot that sees none is slowed down instead, and says
        # so.
        level: AssistLevel = (
            "slow" if asked == "steer" and "assist" not in self._kernel.capabilities else asked
        )
        self._kernel.assist.level = level

    def _set_networks(self) -> None:
        """Give the driver the network that is theirs. What is still on its way is lost with the old
        one.
        """
        networks = in_force(self._driver(), self._config, self._own_networks)
        if networks == self._networks:
            return
        self._networks = networks
        log.info(
            "network_lab", session=networks.session, control=networks.control, video=networks.video
        )
        if self._line is not None:
            self._line.close()
        self._line = (
            TimedLine(networks.control, self._times.now) if networks.control is not None else None
        )
        self._media.impair(networks.video)

    def _networks_told(self) -> tuple[LabReport | None, LabReport | None]:
        return self._line.report() if self._line is not None else None, self._media.network

    def _say_changes(self, before: RcaState, after: RcaState) -> None:
        if after.battery.charging and not before.battery.charging:
            self.reports.event("charging")
        self._feel(before, after)
        if after.pose.localized != before.pose.localized:
            self.reports.event(
                "localization_found" if after.pose.localized else "localization_lost"
            )

    def _feel(self, before: RcaState, after: RcaState) -> None:
        """Stop for a contact that begins, and go no further towards one that lasts."""
        felt = sides_of(after.bumper or ())
        if after.contacts > before.contacts or felt - sides_of(before.bumper or ()):
            self._kernel.touched(felt)
            self.turn_wheels()
            self.reports.event("collision", detail=" ".join(side for side in SIDES if side in felt))
        self._kernel.contacts.felt(felt)

    # --- faults and what is remembered ------------------------------------------------------------

    def _set_fault(self, name: str, text: str) -> None:
        self._faults[name] = text
        self.reports.errors[name] = f"{name}: {text}"[:300]
        self._kernel.set_fault(name)
        self.turn_wheels()

    def _clear_fault(self, name: str) -> None:
        if self._faults.pop(name, None) is None:
            return
        self.reports.errors.pop(name, None)
        if not self._faults:
            self._kernel.clear_fault(self._times.now())

    async def _look_at_disk(self) -> None:
        """Ask for the space that is left off the loop, which a disk that hangs must not hold up."""
        try:
            self._shortage = await asyncio.to_thread(self._store.shortage)
        finally:
            self._looks_at_disk = False

    async def _keep_latch(self) -> None:
        async with self._writing:
            latch = self._kernel.latch
            if latch != self._kept_latch and await self._write(
                lambda: self._store.keep_latch(latch)
            ):
                self._kept_latch = latch

    async def _keep_lease(self) -> None:
        async with self._writing:
            newest = self._kernel.leases.newest
            if newest is not None:
                await self._write(lambda: self._store.keep_lease(newest))

    async def _write(self, write: Callable[[], None]) -> bool:
        """Write off the loop and tell whether it was done; a full disk is reported, and the robot
        keeps what it has in memory.
        """
        try:
            await asyncio.to_thread(write)
        except OSError as error:
            log.exception("store_failed")
            self.reports.errors[STORE] = f"{STORE}: {error.strerror or error}"[:300]
            return False
        self.reports.errors.pop(STORE, None)
        return True


def _shows_need(message: Any) -> bool:
    """Tell whether a message of the server is from somebody who needs the robot."""
    match message:
        case VelocityCommand() | Action() | Lease() | PictureRequest():
            return True
        case CommandHeartbeat():
            return message.needed
    return False
