"""The safety kernel: the only thing between a message and the wheels. It runs on the robot's side
of every link.

The kernel decides and does no I/O: it has no sockets, no threads and no clock (`now` is monotonic
time in seconds, `unix` this computer's Unix time). Its caller sends `Decision.velocity` to the
base, cancels what `drain_cancelled` names, and sends nothing otherwise. In every tick a velocity
passes the same stages:

    driver ──────────────┐
    navigation, passed on┴► permission ► limits ► collision monitor ► ramp ► base
    the RCA's navigation: watched

Exactly one controller (controllers.py) moves the base. The collision monitor is a pure object that
the kernel is given (`Shaper`); it shapes what a driver asks for, because our navigation avoids
obstacles itself. Limits hold after it as well as before. `commanded` is what the base was last
sent.

The rules, in the order in which they apply:

- Stop and e-stop are obeyed from every sender, at any age, under any lease. An e-stop of someone
  responsible for the robot latches (estop_latch.py).
- A velocity counts when the driver sent it with an input method and on a transport that the lease
  allows (permissions.py), it is newer than every other of its epoch, and young enough
  (freshness.py).
- A stop by someone other than the driver holds the robot until the driver releases the controls
  (hold.py). So do a cleared e-stop, a contact without a direction, and a reconnected robot.
  Without a lease, a person's stop holds until a new driver or a person releases it.
- Without an accepted velocity for `Limits.deadman` the robot brakes. Navigation ends 2 s after the
  last heartbeat of the driver, or of the server when the server ordered it.
- When idle, the kernel sends nothing, so that it does not compete with a planner. After any motion
  it sends zeros until the robot is measured at rest, and for as long as the RCA has not confirmed
  the end of an action.
- The RCA's own navigation begins when the robot is at rest. It ends when it drives faster than the
  limits in force. However it ends, the robot is braked from its measured speed, and no velocity
  is accepted before it is at rest. Navigation that runs in the agent, or whose velocities pass
  through it, gets what the limits leave of them.
- A robot that is measured moving while nothing may move it is braked again, for as long as it
  moves, and the kernel reports it (`moves_despite_stop`).
- A contact stops the robot. Nothing moves it further that way before it has been backed away
  (contacts.py).

This file is longer than most, so that an assessor reads all of it on one page.
"""

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass, field, replace
from typing import Protocol

from robots.agent.ramp import (
    ZERO,
    Caps,
    assist_speed,
    caps,
    check_times,
    is_within,
    no_faster,
    ramp,
)
from robots.agent.safety.clock_sync import SERVER_PEER, PeerClocks
from robots.agent.safety.contacts import Contacts, Side
from robots.agent.safety.controllers import Change, Controller, after
from robots.agent.safety.estop_latch import BUTTON, EStopLatch, refusal as latch_refusal, stricter
from robots.agent.safety.freshness import judge
from robots.agent.safety.hold import DriveHold, LeaseGrant
from robots.agent.safety.lease import LeaseKeeper, Remembered
from robots.agent.safety.permissions import (
    MOVING,
    CommandSender,
    forbidden,
    mismatch,
    refusal,
    role_of,
    staleness,
)
from robots.api.messages import (
    Action,
    AssistLevel,
    Capability,
    ClearEStop,
    EStop,
    Lease,
    Limits,
    Mode,
    Stop,
    Velocity,
    VelocityCommand,
    Way,
)


@dataclass(frozen=True)
class KernelParams:
    # s without a heartbeat, after which what the robot does by itself ends
    navigation_silence: float = 2.0
    max_step: float = 0.04  # s, two ticks: the longest time that one output may accelerate for
    at_rest_for: float = 0.3  # s of measurements that show the robot at rest
    # s, the same for a robot that has moved although nothing may move it
    at_rest_after_unbidden: float = 2.0
    # s after its last velocity other than zero, from which a robot that moves is an error
    moves_despite_stop_after: float = 0.4
    longest_wait: float = 0.3  # s for which an adapter may hold a velocity back until it is sent
    rest_timeout: float = 5.0  # s: a robot that is not measured at rest by then is an error
    overspeed: float = 1.1  # times the limit: the RCA's navigation may not drive faster than that
    overspeed_for: float = 0.5  # s
    grants_kept: int = 16  # newest
    stops_kept: int = 256  # newest
    same_stop: float = 3.0  # s within which an emergency stop that comes again is the same one


KERNEL = KernelParams()
STANDSTILL = Velocity(linear=0.02, angular=0.05)


@dataclass(frozen=True)
class Decision:
    """The velocity to send to the base, None for silence, and why in one word."""

    velocity: Velocity | None
    why: str


@dataclass(frozen=True)
class CommandVerdict:
    """The result of a velocity command: a `reason` for refusal, or its age in seconds, the velocity
    that limits and age leave of it, and the share of the largest speeds that its age left.
    """

    reason: str | None
    age: float = 0.0
    allowed: Velocity = ZERO
    share: float = 0.0


@dataclass(frozen=True)
class Navigation:
    """The robot's own motion: an action ordered at `since` (monotonic seconds), from when
    heartbeats are expected. It `may_begin` once the robot is at rest.
    """

    action_id: str
    mode: Mode
    ordered_by_server: bool
    since: float
    may_begin: bool = False


class Shaped(Protocol):
    """The result of a shaper. The driver's ramp continues from `own`."""

    @property
    def velocity(self) -> Velocity:
        """The velocity for the base."""

    @property
    def own(self) -> Velocity:
        """The same without the added turn."""


class Shaper(Protocol):
    """The stage between limits and ramp, which knows the obstacles near the robot. Pure."""

    def shape(
        self, wanted: Velocity, last_sent: Velocity, level: AssistLevel, now: float
    ) -> Shaped:
        """Return the safe part of `wanted`; `last_sent` is what the base was last sent."""


@dataclass
class AssistInForce:
    """The active assistance, and the clearance in metres on which its speed depends."""

    level: AssistLevel = "off"
    clearance: float | None = None


@dataclass
class Kernel:
    """All state on which safety depends.

    The limits are the robot's own, which a lease can only lower; the base stops by itself after
    `watchdog` seconds without a velocity. `latch` and `newest_lease` are those of the last run.
    `monitor` shapes a driver's velocity, None without sensors for obstacles or with an RCA that
    assists. A robot whose measured speeds (m/s, rad/s) do not exceed `standstill` is at rest.
    Raises ValueError when deadman or watchdog is too long to stop the robot soon enough.
    """

    limits: Limits
    watchdog: float
    capabilities: frozenset[Capability]
    latch: EStopLatch | None = None
    newest_lease: Remembered | None = None
    monitor: Shaper | None = None
    standstill: Velocity = STANDSTILL
    clocks: PeerClocks = field(default_factory=PeerClocks)
    assist: AssistInForce = field(default_factory=AssistInForce)
    fault: str | None = None
    button_pressed: bool = False
    navigation: Navigation | None = None
    refused: Counter[str] = field(default_factory=Counter)
    cancelled: list[tuple[str, str]] = field(default_factory=list)
    stop_seq: int | None = None
    stop_id: str | None = None
    driver_heartbeat_at: float | None = None
    visitor_heartbeat_at: float | None = None
    server_heartbeat_at: float | None = None
    # the RCA has not confirmed the end of an action that may move the robot
    is_end_unconfirmed: bool = False
    yields: bool = False  # another agent controls this robot

    def __post_init__(self) -> None:
        check_times(self.watchdog, self.limits)
        self.leases = LeaseKeeper(self.newest_lease)
        # of a session and an epoch: the highest number that counted
        self._floors: dict[tuple[str | None, int], int] = {}
        self._stops: dict[tuple[str, str], float] = {}
        self._target = ZERO  # what the driver wants, within permission and limits
        self._own = ZERO  # as far as the ramp has it, without what the collision monitor added
        self._current = ZERO  # as far as the ramp has it, with what was added
        self._sent = ZERO  # what the base was last sent
        self._output_at = self._accepted_at = self._now = float("-inf")
        # An agent that starts in the middle of a drive does not know whether a key is held down.
        self._hold: DriveHold | None = DriveHold(None, None, float("-inf"))
        self._driven_by: Way | None = None  # the transport of the driver's last velocity
        self._motion, self._measured_at = ZERO, float("-inf")  # as measured last, and when
        self._at_rest_since: float | None = None
        self._sent_zero_since: float | None = None
        self._too_fast_since: float | None = None
        self._moved_unbidden = False  # since the robot was last at rest
        self.controller = Controller.NONE
        self.contacts = Contacts()

    # --- who drives -------------------------------------------------------------------------------

    def take_lease(self, lease: Lease | None, *, retained: bool, now: float) -> bool:
        """Take a lease, None for no session; return False for one older than the newest known."""
        self._now = now
        before = self.leases.live(now)
        if lease is None:
            self.leases.clear()
        elif not self.leases.take(lease, retained=retained, now=now):
            self.refused["old_lease"] += 1
            return False
        self._driver_changed(before, self.leases.live(now))
        return True

    def _driver_changed(self, before: Lease | None, lease: Lease | None) -> None:
        """Void the commands of the previous driver when the grant changes: its session, epoch, or
        hidden operator's epoch. The robot then brakes to rest.

        A renewal of the same grant changes nothing here, and a lapsed lease that returns must not
        release a hold: its driver may still hold a key down. Navigation ends with the lease that
        permitted it; an action that the server ordered continues unless the robot is held.
        """
        if _grant(before) == _grant(lease):
            return
        self._target, self._accepted_at = ZERO, float("-inf")
        self.driver_heartbeat_at = self._driven_by = None
        if before is None or lease is None or before.peer != lease.peer:
            self.visitor_heartbeat_at = None
        grant = _grant(lease)
        if (
            self._hold is not None
            and lease is not None
            and grant is not None
            and self._hold.take_lease(grant, is_new=lease.renewal == 0)
        ):
            self._hold = None
        if self.navigation and not self.navigation.ordered_by_server:
            self._cancel_navigation("lease_changed")
        elif self.held:
            self._cancel_navigation("stopped")
        self._change(Change.DRIVER_CHANGED)

    def heartbeat(self, peer: str, transport: Way, now: float) -> None:
        """Take a heartbeat. The driver's keeps navigation going, and shows that silence means
        released controls; the server's keeps actions going that the server ordered.
        """
        if peer == SERVER_PEER:
            self.server_heartbeat_at = now
        lease = self.leases.live(now)
        if lease is not None and lease.peer == peer:
            self.visitor_heartbeat_at = now
        if lease is not None and lease.driver == peer:
            self.driver_heartbeat_at = now
            if self._hold is not None and self._hold.take_heartbeat(transport, now):
                self._hold = None

    # --- velocities -------------------------------------------------------------------------------

    def velocity(
        self, command: VelocityCommand, sender: CommandSender, *, now: float, unix: float
    ) -> CommandVerdict:
        """Judge a velocity command; an accepted one is the target that `tick` approaches."""
        lease = self.leases.live(now)
        reason = mismatch(command.session, command.epoch, sender, lease)
        if sender.retained:
            reason = "retained"
        if reason or lease is None:
            return self._refuse(reason or "no_lease")
        if forbidden(lease, sender, method=command.method):
            return self._refuse("not_allowed")
        moving = command.linear != 0.0 or command.angular != 0.0
        self._driven_by = sender.transport
        if moving and self._hold is not None:
            self._hold.take_velocity(sender.transport, now)
        grant = command.session, command.epoch
        if command.seq <= self._floors.get(grant, -1):
            return self._refuse("old_seq")
        clock = self.clocks.of(lease.driver) if lease.driver is not None else None
        fresh = judge(command, lease, self.limits, clock, now=now, unix=unix)
        if fresh.reason:
            return self._refuse(fresh.reason, fresh.age)
        self._raise_floor(grant, command.seq)
        if not moving:
            self._hold = None  # the driver has released the controls
        if reason := self._unmoved(moving=moving):
            return self._refuse(reason, fresh.age)
        self._cancel_navigation("manual")
        asked = Velocity(linear=command.linear, angular=command.angular)
        self._target, self._accepted_at = self.caps(now).clamp(asked, fresh.scale), now
        return CommandVerdict(None, fresh.age, self._target, fresh.scale)

    def tick(self, now: float, wanted: Velocity | None = None) -> Decision:
        """Return the output for the base; call at 50 Hz and after each accepted command or stop.

        `wanted` is the velocity of navigation that passes through the kernel; without it the RCA
        moves the base itself.
        """
        passed, self._now = now - self._now, now
        self._watch_navigation(now)
        self._watch_motion(now)
        is_blocked = self.is_stopped or self.fault is not None
        if self.navigation and self.navigation.may_begin and not is_blocked:
            if wanted is None and self.controller is not Controller.NAVIGATION:
                self._change(Change.HANDED_OVER)
                self.contacts.moved(self._motion.linear * min(passed, KERNEL.max_step))
                return Decision(None, "navigating")
            self._change(Change.PASSED_ON)
            return self._navigated(wanted or ZERO, now)
        why = self.braking(now)
        if why:
            self._target = ZERO
        return self._output(self._target, why or "driving", now)

    def applied(self, velocity: Velocity) -> None:
        """Take the velocity that was really sent; the ramp continues from it (`_follow_sent`)."""
        self._sent = velocity

    def measured(self, velocity: Velocity, now: float) -> None:
        """Take a measured velocity."""
        self._motion, self._measured_at = velocity, now
        if not self._moves():
            if self._at_rest_since is None:
                self._at_rest_since = now
            return
        self._at_rest_since = None
        resumed = self.is_end_unconfirmed and self.moves_despite_stop(now)
        unbidden = self.controller is Controller.NONE and not self.yields
        if unbidden or (self.controller is Controller.DRIVER and resumed):
            self._moved_unbidden = True
            self._change(Change.MOVES_UNBIDDEN)

    def touched(self, sides: Collection[Side] = ()) -> None:
        """Take a contact: stop, end the RCA's own motion, and allow none towards it. Without a side
        it is in the direction of motion.
        """
        forward = self.commanded.linear
        if forward == 0.0 and abs(self._motion.linear) > self.standstill.linear:
            forward = self._motion.linear
        if not sides and forward != 0.0:
            sides = ["ahead" if forward > 0.0 else "behind"]
        elif not sides and not self._docks():
            self._hold_on(self._now)
        self.contacts.felt(sides)
        self._target = ZERO
        self._brake_until_rest()
        # a station is there to be touched
        if self.navigation and not self._docks() and self.controller is not Controller.NAVIGATION:
            self._cancel_navigation("collision")

    @property
    def is_at_rest(self) -> bool:
        """Tell whether the robot was measured at rest since its last motion."""
        return self.controller is Controller.NONE

    def moves_despite_stop(self, now: float) -> bool:
        since = self._sent_zero_since
        return since is not None and self._moves() and now - since > KERNEL.moves_despite_stop_after

    def settles_too_long(self, now: float) -> bool:
        """Tell whether driver or navigation has waited too long for the robot to be measured at
        rest.
        """
        since = self._sent_zero_since
        return not self.is_at_rest and since is not None and now - since > KERNEL.rest_timeout

    def caps(self, now: float) -> Caps:
        """Return the largest speeds allowed now: the least of robot, lease and assistance."""
        lease = self.leases.live(now)
        # a collision monitor, ours or the RCA's, slows down better: it knows where obstacles are
        has_monitor = self.monitor is not None or "assist" in self.capabilities
        level = "off" if has_monitor else self.assist.level
        assisted = assist_speed(level, self.assist.clearance, self.limits)
        return caps(self.limits, lease.limits if lease else None, assisted)

    def inhibited(self, now: float) -> str | None:
        """Return in one word why velocities cannot move the robot, or not everywhere; or None."""
        if reason := self._barred(now):
            return reason
        if self.controller is Controller.SETTLING:
            return "settling"
        return "collision" if self.contacts else None

    def braking(self, now: float) -> str | None:
        """Return in one word why the base gets zeros now, None while it is driven."""
        if reason := self._barred(now):
            return reason
        if self.controller is Controller.SETTLING or self.navigation:
            return "settling"
        return "deadman" if now >= self._accepted_at + self.limits.deadman else None

    def deadline(self) -> float | None:
        """Return when the deadman brakes, None while nothing moves."""
        return self._accepted_at + self.limits.deadman if self._target != ZERO else None

    @property
    def held(self) -> bool:
        """Tell whether a stop, or an equivalent, waits for its release."""
        return self._hold is not None and (
            self._hold.by_person or self.leases.live(self._now) is not None
        )

    def visitor_silence(self, now: float) -> float | None:
        """Return the seconds since the last heartbeat of the visitor, who drives unless a wizard
        does; None without a live lease.
        """
        if self.visitor_heartbeat_at is None or not self.leases.live(now):
            return None
        return now - self.visitor_heartbeat_at

    @property
    def is_stopped(self) -> bool:
        """Tell whether an e-stop, or a stop that waits for its release, is active."""
        return self.latch is not None or self.held

    @property
    def is_released(self) -> bool:
        """Tell whether neither an e-stop nor a hold is in force, also none that only waits for the
        next lease.
        """
        return self.latch is None and self._hold is None

    @property
    def is_held_by_person(self) -> bool:
        """Tell whether a person's stop waits for its release, also without a lease."""
        return self._hold is not None and self._hold.by_person

    @property
    def commanded(self) -> Velocity:
        """The velocity that the base was last sent."""
        return self._sent

    @property
    def is_waiting(self) -> bool:
        """Tell whether the adapter has not sent the newest velocity."""
        return self._sent != self._current

    # --- stop -------------------------------------------------------------------------------------

    def stop(self, action: Stop, sender: CommandSender, now: float) -> bool:
        """Brake. Return False for a repetition of an obeyed stop after which the driver has
        continued.
        """
        lease = self.leases.live(now)
        own = (
            role_of(action, sender, lease) == "driver"
            and mismatch(action.session, action.epoch, sender, lease) is None
        )
        grant = action.session, action.epoch
        floor = self._floors.get(grant, -1)
        self.stop_seq, self.stop_id = action.seq, action.action_id
        if self._repeats("stop", action.action_id, now) and (not own or action.seq <= floor):
            return False
        self._remember_stop("stop", action.action_id, now)
        if own:
            self._raise_floor(grant, max(floor, action.seq))
        else:
            # The page of a driver whose lease has just ended stops the robot as well.
            newest = self.leases.newest
            is_late = newest is not None and action.session == newest.session
            self._hold_on(now, by_person=lease is not None or not is_late)
        self._halt("stopped", now)
        return True

    def brake(self, now: float) -> None:
        """Brake for a reason of the agent's own, until the driver releases the controls."""
        self._hold_on(now)
        self._halt("stopped", now)

    def estop(self, action: EStop, sender: CommandSender, *, now: float, unix: float) -> bool:
        """Brake, and latch if the sender is responsible for the robot; an observer's e-stop is a
        stop. Return False for a repetition of an obeyed one.
        """
        lease = self.leases.live(now)
        role = role_of(action, sender, lease)
        if role == "observer":
            return self.stop(
                Stop(action_id=action.action_id, stamp=action.stamp, role="observer"), sender, now
            )
        if self._repeats("estop", action.action_id, now):
            return False
        self._remember_stop("estop", action.action_id, now)
        user = lease.who if lease and role == "driver" else ""
        if sender.transport == "mqtt":
            user = action.user
        self._press(EStopLatch(role, unix, user, action.detail), now)
        return True

    def button(self, *, pressed: bool, now: float, unix: float) -> bool:
        """Take the state of the robot's own emergency button; return True when newly pressed."""
        newly, self.button_pressed = pressed and not self.button_pressed, pressed
        if newly:
            self._press(EStopLatch(BUTTON, unix), now)
        return newly

    def set_fault(self, reason: str) -> None:
        """Refuse all motion until `clear_fault`: the base is lost, or must not move."""
        self.fault = reason
        self._cancel_navigation("fault")
        self._target = ZERO

    def clear_fault(self, now: float) -> None:
        """Accept the base again. It is measured at rest before anything moves it."""
        self.fault, self._now = None, now
        self._hold_on(now)
        self._own = self._current = self._sent = self._target = ZERO
        self._sent_zero_since = None  # the zeros before did not reach the base
        self._brake_until_rest()
        self._change(Change.DRIVER_CHANGED)

    # --- actions ----------------------------------------------------------------------------------

    def permit(
        self, action: Action, sender: CommandSender, *, now: float, unix: float
    ) -> str | None:
        """Return in one word why an action other than stop and e-stop is refused, and count it; or
        None.
        """
        reason = self._why_not(action, sender, now=now, unix=unix)
        if reason:
            self.refused[reason] += 1
        return reason

    def clear_estop(self, now: float) -> None:
        """Open the latch for a permitted clear_estop; without a latch, release a stop that holds
        the robot without a lease.
        """
        if self.latch is not None:
            self.latch = None
            self._hold_on(now)
        elif self.leases.live(now) is None:
            self._hold = None

    def navigate(self, action_id: str, mode: Mode, *, ordered_by_server: bool, now: float) -> None:
        """Let the robot move by itself once it is at rest, which `navigation.may_begin` shows."""
        self._cancel_navigation("replaced")
        self.navigation = Navigation(action_id, mode, ordered_by_server, now)
        self._target = ZERO

    def navigation_ended(self, action_id: str) -> bool:
        """End the robot's own motion; return False when this action was not it."""
        if self.navigation is None or self.navigation.action_id != action_id:
            return False
        self._leave_navigation()
        return True

    def cancel(self, action_id: str | None) -> str | None:
        """Cancel the named navigation, any with None; return its id, None when there was none."""
        running = self.navigation
        if running is None or action_id not in {None, running.action_id}:
            return None
        self._cancel_navigation("cancelled")
        return running.action_id

    def drain_cancelled(self) -> list[tuple[str, str]]:
        """Return (action id, reason) of the navigation to cancel at the adapter, once each."""
        drained, self.cancelled = self.cancelled, []
        return drained

    # --- inside -----------------------------------------------------------------------------------

    def _refuse(self, reason: str, age: float = 0.0) -> CommandVerdict:
        self.refused[reason] += 1
        return CommandVerdict(reason, age)

    def _unmoved(self, *, moving: bool) -> str | None:
        """Return why a valid command of the driver does not move the robot; a zero releases a hold
        and does not interrupt navigation.
        """
        if self.latch:
            return "estop"
        if self.fault:
            return "fault"
        if moving:
            return "stopped" if self.held else "unconfirmed" if self.is_end_unconfirmed else None
        return "navigating" if self.navigation else None

    def _barred(self, now: float) -> str | None:
        """Return in one word why no driver may move the robot now, or None."""
        if self.latch:
            return "estop"
        if self.fault:
            return "fault"
        if self.held:
            return "stopped"
        if self.is_end_unconfirmed:
            return "unconfirmed"
        return None if self.leases.live(now) else "no_lease"

    def _why_not(
        self, action: Action, sender: CommandSender, *, now: float, unix: float
    ) -> str | None:
        """Return why an action is refused, None if it may begin.

        Permission comes first, then the age, then the robot's own state, which refuses only actions
        that move it. Without a lease, clearing the emergency stop also releases a hold.
        """
        lease = self.leases.live(now)
        reason = refusal(action, sender, lease, self.capabilities) or staleness(
            action, sender, lease, self.clocks, now=now, unix=unix
        )
        if reason:
            return reason
        if isinstance(action, ClearEStop):
            if self.latch is None and self.held and lease is None:
                return None  # it releases the hold
            return latch_refusal(self.latch, action, button_pressed=self.button_pressed)
        if not isinstance(action, MOVING):
            return None
        if self.latch:
            return "estop"
        return "fault" if self.fault else "stopped" if self.held else None

    def _press(self, latch: EStopLatch, now: float) -> None:
        self.latch = stricter(self.latch, latch)
        self._halt("estop", now)

    def _halt(self, reason: str, now: float) -> None:
        self._now = now
        self._cancel_navigation(reason)
        self._target, self._accepted_at = ZERO, float("-inf")
        self._brake_until_rest()

    def _cancel_navigation(self, reason: str) -> None:
        if self.navigation:
            self.cancelled.append((self.navigation.action_id, reason))
            self._leave_navigation()

    def _leave_navigation(self) -> None:
        """Brake from the speed that the RCA has left."""
        self.navigation = self._too_fast_since = None
        if self.controller is Controller.RCA:
            self._own = self._current = self._sent = self.caps(self._now).clamp(self._motion)
            self._output_at, self._at_rest_since = self._now, None
        self._change(Change.NAVIGATION_LEFT)

    def _docks(self) -> bool:
        return self.navigation is not None and self.navigation.mode == "docking"

    def _change(self, event: Change) -> None:
        self.controller = after(self.controller, event)

    def _brake_until_rest(self) -> None:
        """Send zeros until the robot has been measured at rest from now on."""
        self._at_rest_since = None
        self._change(Change.DRIVEN)

    def _moves(self) -> bool:
        return not is_within(self._motion, self.standstill)

    def _watch_motion(self, now: float) -> None:
        """Note since when the robot should be at rest, and whether it is."""
        if self.controller in {Controller.NAVIGATION, Controller.RCA}:
            self._at_rest_since = self._sent_zero_since = None
            return
        if self._current != ZERO or self._sent != ZERO:
            self._brake_until_rest()
            self._sent_zero_since = None
            return
        if self._sent_zero_since is None or (self.is_at_rest and not self._moves()):
            self._sent_zero_since = now
        needed = KERNEL.at_rest_after_unbidden if self._moved_unbidden else KERNEL.at_rest_for
        if self._at_rest_since is not None and self._measured_at - self._at_rest_since >= needed:
            self._moved_unbidden = False
            self._change(Change.AT_REST)
        if self.is_at_rest and self.navigation and not self.is_end_unconfirmed:
            self.navigation = replace(self.navigation, may_begin=True)

    def _hold_on(self, now: float, *, by_person: bool = False) -> None:
        by_person = by_person or (self._hold is not None and self._hold.by_person)
        self._hold = DriveHold(_grant(self.leases.live(now)), self._driven_by, now, by_person)
        if self.held:
            self._cancel_navigation("stopped")

    def _watch_navigation(self, now: float) -> None:
        """End the robot's own motion without the heartbeats of the driver, or of the server that
        ordered it, and the RCA's above the limits or into a contact.
        """
        running = self.navigation
        if running is None:
            return
        last = self.server_heartbeat_at if running.ordered_by_server else self.driver_heartbeat_at
        if not running.ordered_by_server and self.leases.live(now) is None:
            self._cancel_navigation("no_lease")
        elif now - max(running.since, last or running.since) >= KERNEL.navigation_silence:
            self._cancel_navigation("heartbeat_lost")
        elif self.controller is Controller.RCA and self._drives_too_fast(now):
            self._cancel_navigation("too_fast")
        elif self.controller is Controller.RCA and self._drives_into_contact():
            self._cancel_navigation("collision")

    def _drives_into_contact(self) -> bool:
        towards = self.contacts.clamp(self._motion) != self._motion
        return towards and self._moves() and not self._docks()

    def _drives_too_fast(self, now: float) -> bool:
        """Tell whether the RCA has driven the robot faster than the limits for too long."""
        caps, motion = self.caps(now), self._motion
        forward = caps.linear if motion.linear > 0.0 else caps.reverse
        largest = Velocity(
            linear=max(KERNEL.overspeed * forward, self.standstill.linear),
            angular=max(KERNEL.overspeed * caps.angular, self.standstill.angular),
        )
        if is_within(motion, largest):
            self._too_fast_since = None
        elif self._too_fast_since is None:
            self._too_fast_since = now
        since = self._too_fast_since
        return since is not None and now - since >= KERNEL.overspeed_for

    def _raise_floor(self, grant: tuple[str | None, int], seq: int) -> None:
        self._floors.pop(grant, None)
        self._floors[grant] = seq
        if len(self._floors) > KERNEL.grants_kept:
            del self._floors[next(iter(self._floors))]

    def _repeats(self, kind: str, action_id: str, now: float) -> bool:
        return now - self._stops.get((kind, action_id), float("-inf")) < KERNEL.same_stop

    def _remember_stop(self, kind: str, action_id: str, now: float) -> None:
        self._stops.pop((kind, action_id), None)
        self._stops[kind, action_id] = now
        if len(self._stops) > KERNEL.stops_kept:
            del self._stops[next(iter(self._stops))]

    def _output(self, target: Velocity, why: str, now: float) -> Decision:
        self._approach(target, now, shaped=target != ZERO)
        # the speed that the robot has lost since navigation left it is not added again
        if self.controller is Controller.SETTLING:
            self._own = self._current = no_faster(self._current, self._motion)
        if self._current != ZERO:
            self._change(Change.DRIVEN)
        elif self.is_at_rest and not self.is_end_unconfirmed:
            return Decision(None, "idle")
        self._output_at, self._sent = now, self._current
        return Decision(self._current, why)

    def _navigated(self, wanted: Velocity, now: float) -> Decision:
        """Return navigation's velocity within limits and ramps; zeros too, because they hold the
        base in place.
        """
        self._approach(wanted, now)
        self._output_at, self._sent = now, self._current
        return Decision(self._current, "navigating")

    def _approach(self, target: Velocity, now: float, *, shaped: bool = False) -> None:
        """Pass a target through limits, collision monitor (if `shaped`) and ramp."""
        since = now - self._output_at
        if since > self.watchdog:
            # the base has stopped by itself; continuing from the old speed would start it again
            self._own = self._current = self._sent = ZERO
        step = min(since, KERNEL.max_step)
        self.contacts.moved(self._sent.linear * step)
        allowed = self._limited(target, now)
        if self._sent != self._current:
            self._follow_sent(allowed)
        if shaped and self.monitor is not None and self.assist.level != "off":
            allowed = self._shaped(ramp(self._own, allowed, self.limits, dt=step), now)
            self._current = ramp(self._current, allowed, self.limits, dt=step)
        else:  # a braking robot stays on the course that was checked before
            self._own = self._current = ramp(self._current, allowed, self.limits, dt=step)

    def _follow_sent(self, allowed: Velocity) -> None:
        """Continue the ramp from what was really sent: ahead of it by at most the time that a
        velocity may wait in the adapter, and not at all when braking.
        """
        wait = KERNEL.longest_wait
        self._own = ramp(self._sent, self._own, self.limits, dt=wait)
        self._current = ramp(self._sent, self._current, self.limits, dt=wait)
        if no_faster(allowed, self._current) != self._current:
            self._own = no_faster(self._own, self._sent)
            self._current = no_faster(self._current, self._sent)

    def _limited(self, velocity: Velocity, now: float) -> Velocity:
        touches_station = self._docks() and self.controller is Controller.NAVIGATION
        free = velocity if touches_station else self.contacts.clamp(velocity)
        return self.caps(now).clamp(free)

    def _shaped(self, wanted: Velocity, now: float) -> Velocity:
        """Return what the collision monitor leaves of a velocity, inside the limits."""
        assert self.monitor is not None
        found = self.monitor.shape(wanted, self._sent, self.assist.level, now)
        allowed = self._limited(found.velocity, now)
        # less of an added turn that exceeds a limit leads elsewhere, so check again
        if allowed != found.velocity:
            found = self.monitor.shape(allowed, self._sent, "slow", now)
        self._own = found.own
        return found.velocity


def _grant(lease: Lease | None) -> LeaseGrant | None:
    return (lease.session, lease.epoch, lease.wizard_epoch) if lease else None
