"""The safety kernel: the only thing between a message and the wheels. It runs on the robot's side
of every link.

It decides and does nothing: no sockets, no threads, no clock of its own (`now` is monotonic time in
seconds, `unix` this computer's Unix time). Its caller sends what `Decision.velocity` says to the
base, cancels what `cancelled` names, and stays silent otherwise. A velocity passes these stages, in
every tick and on every path:

    driver ──────────────┐
    navigation (ours) ───┴► permission ► limits ► collision monitor ► ramp ► base
    navigation (the RCA's): hands off, but watched

The collision monitor is a pure object that the kernel is given (`Shaper`), and shapes what a driver
asks for; our navigation looks out for itself. Limits hold after it as well as before. What the base
was last told is `commanded`, whoever moved it.

The rules, in the order in which they bite:

- Stop and e-stop are obeyed whoever sends them, however old, whatever the lease. An e-stop of
  whoever is answerable latches (latch.py).
- A velocity counts when it is the driver's and of an input method and on a way that the lease
  allows (permissions.py), newer than every other of its epoch, and young enough (freshness.py).
- Somebody else's stop holds the robot until the driver has let go (hold.py). So do a cleared e-stop
  and a robot that has come back.
- Without an accepted velocity for `Limits.deadman` the robot brakes. Navigation ends 2 s after the
  driver's last heartbeat.
- Idle is silence, so that nobody fights a planner; but from the last that moved the robot until it
  was measured to stand, zeros are sent.
- The RCA's own navigation begins when the robot was measured to stand, and is left alone while it
  runs. However it ends, the robot is braked from the speed that was measured last, and nobody
  drives before it stands. Navigation that runs in the agent itself (contract.Navigating) tells here
  what it wants, and gets what the limits leave of it.
- A contact stops the robot. Nothing moves it further that way before it has been backed away
  (contact.py).

Longer than most files, because whoever answers for a robot wants all of it on one page.
"""

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass, field, replace
from typing import Protocol

from robots.agent.ramp import ZERO, Caps, assist_speed, caps, check_times, no_faster, ramp
from robots.agent.safety.clock_sync import PeerClock, PeerClocks
from robots.agent.safety.contacts import Contacts, Side
from robots.agent.safety.estop_latch import BUTTON, EStopLatch, stricter
from robots.agent.safety.estop_latch import refusal as latch_refusal
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
    """Times and thresholds of the safety kernel that no limit of the robot or the lease sets."""

    # s without the driver, after which what the robot does by itself ends
    navigation_silence: float = 2.0
    max_step: float = 0.04  # s, two ticks: the longest time that one output may accelerate for
    standstill: float = 0.02  # m/s: a robot that is slower stands
    standstill_turning: float = 0.05  # rad/s, the same
    stands_for: float = 0.3  # s for which it has to have been measured so
    # s beyond its braking time: a robot that moves, though told to stand, is an error
    runs_on_after: float = 2.0
    grants_kept: int = 16  # newest
    stops_kept: int = 256  # newest
    same_stop: float = 3.0  # s within which an emergency stop that comes again is the same one


KERNEL = KernelParams()


@dataclass(frozen=True)
class Decision:
    """What to send to the base: a velocity, or None for silence; `why` in one word."""

    velocity: Velocity | None
    why: str


@dataclass(frozen=True)
class CommandVerdict:
    """What became of a velocity command: refused for a `reason`, or accepted with its age in
    seconds, what limits and age leave of it, and the share of the largest speeds that its age left.
    """

    reason: str | None
    age: float = 0.0
    allowed: Velocity = ZERO
    share: float = 0.0


@dataclass(frozen=True)
class Navigation:
    """What the robot is doing by itself: an action, and since when the driver counts as heard. It
    `may_begin` once the robot stands.
    """

    action_id: str
    mode: Mode
    ordered_by_server: bool
    since: float
    may_begin: bool = False


class Shaped(Protocol):
    """What a shaper makes of a velocity; `own` is what of it is the driver's, from where the
    driver's ramp goes on.
    """

    @property
    def velocity(self) -> Velocity:
        """What to tell the base."""

    @property
    def own(self) -> Velocity:
        """The same without the turn that was added."""


class Shaper(Protocol):
    """The stage between limits and ramp: it knows what stands about the robot, and does no I/O."""

    def shape(self, wanted: Velocity, told: Velocity, level: AssistLevel, now: float) -> Shaped:
        """Return what is safe of `wanted`, to a base that was last `told` so."""


@dataclass
class AssistInForce:
    """The assistance in force and the clearance in metres that it goes by."""

    level: AssistLevel = "off"
    clearance: float | None = None


@dataclass
class Kernel:
    """All of the state that safety depends on.

    Args:
        limits: the robot's own; a lease can only lower them.
        watchdog: seconds after which the base stops by itself.
        capabilities: what the robot can do.
        latch: an e-stop that was held when the agent ended.
        newest_lease: the newest grant known when the agent ended.
        monitor: shapes what a driver asks for, None on a robot that sees no obstacles, or whose
            architecture assists by itself.

    Raises:
        ValueError: nobody would stop the robot soon enough: deadman or watchdog is too long.
    """

    limits: Limits
    watchdog: float
    capabilities: frozenset[Capability]
    latch: EStopLatch | None = None
    newest_lease: Remembered | None = None
    monitor: Shaper | None = None
    clocks: PeerClocks = field(default_factory=PeerClocks)
    assist: AssistInForce = field(default_factory=AssistInForce)
    fault: str | None = None
    button_pressed: bool = False
    navigation: Navigation | None = None
    refused: Counter[str] = field(default_factory=Counter)
    cancelled: list[tuple[str, str]] = field(default_factory=list)
    stop_seq: int | None = None
    stop_id: str | None = None
    driver_heard: float | None = None
    visitor_heard: float | None = None

    def __post_init__(self) -> None:
        check_times(self.watchdog, self.limits)
        self.leases = LeaseKeeper(self.newest_lease)
        # of a session and an epoch: the highest number that counted
        self._floors: dict[tuple[str | None, int], int] = {}
        self._stops: dict[tuple[str, str], float] = {}
        self._target = ZERO  # what the driver wants, within permission and limits
        self._own = ZERO  # as far as the ramp has it, without what the collision monitor added
        self._current = ZERO  # what the base was last told
        self._output_at = self._accepted_at = self._now = float("-inf")
        self._hold: DriveHold | None = None
        self._knew_driver = False
        self._driven_by: Way | None = None  # the transport of the driver's last velocity
        self._motion = ZERO  # as measured last
        self._still_since: float | None = None
        self._told_to_stand_at: float | None = None
        # the robot may be moving: it was told to, or moves by itself, and has not been measured to
        # stand since
        self._restless = False
        self._yields = False  # whoever drives waits until it stands
        self._hands_off = False  # the RCA moves the robot
        self.contacts = Contacts()

    # --- who drives -------------------------------------------------------------------------------

    def take_lease(self, lease: Lease | None, *, retained: bool, now: float) -> bool:
        """Take a lease, or None for "nobody drives"; return False when it was older than what is
        known.
        """
        before = self.leases.live(now)
        if lease is None:
            self.leases.clear()
        elif not self.leases.take(lease, retained=retained, now=now):
            self.refused["old_lease"] += 1
            return False
        after = self.leases.live(now)
        if _grant(before) != _grant(after):
            # A new driver starts from a standing robot, and the old one's last wish is void.
            self._target, self._accepted_at, self.driver_heard, self._driven_by = (
                ZERO,
                float("-inf"),
                None,
                None,
            )
            if before is None or after is None or before.peer != after.peer:
                self.visitor_heard = None
            self._yields = self._yields or self._restless
            if (
                self._hold is not None
                and after is not None
                and self._hold.is_released_with(_grant(after))
            ):
                self._hold = None
            if after is not None and not self._knew_driver:
                self._knew_driver = True
                # an agent that begins in the middle of a drive: a key may be held
                if after.renewal > 0:
                    self._hold_on(now)
            if self.navigation and not self.navigation.ordered_by_server:
                self._cancel_navigation("lease_changed")
        return True

    def heard(self, peer: str, way: Way, now: float) -> None:
        """Note a heartbeat: the driver's keeps navigation going, and tells that a silence of the
        hands is meant.
        """
        lease = self.leases.live(now)
        if lease is not None and lease.peer == peer:
            self.visitor_heard = now
        if lease is not None and lease.driver == peer:
            self.driver_heard = now
            if self._hold is not None and self._hold.is_released_by(way, now):
                self._hold = None

    # --- velocities -------------------------------------------------------------------------------

    def velocity(
        self, command: VelocityCommand, sender: CommandSender, *, now: float, unix: float
    ) -> CommandVerdict:
        """Judge a velocity command; an accepted one is the new target, which `tick` then
        approaches.
        """
        lease = self.leases.live(now)
        reason = (
            "retained"
            if sender.retained
            else mismatch(command.session, command.epoch, sender, lease)
        )
        if reason or lease is None:
            return self._refuse(reason or "no_lease")
        if forbidden(lease, sender, method=command.method):
            return self._refuse("not_allowed")
        moving = command.linear != 0.0 or command.angular != 0.0
        self._driven_by = sender.way
        if moving and self._hold is not None:
            self._hold.pressed(sender.way, now)
        grant = command.session, command.epoch
        if command.seq <= self._floors.get(grant, -1):
            return self._refuse("old_seq")
        fresh = judge(command, lease, self.limits, self._clock_of_driver(lease), now=now, unix=unix)
        if fresh.reason:
            return self._refuse(fresh.reason, fresh.age)
        self._raise_floor(grant, command.seq)
        if not moving:
            self._hold = None  # the driver has let go
        if reason := self._unmoved(moving=moving):
            return self._refuse(reason, fresh.age)
        self._cancel_navigation("manual")
        asked = Velocity(linear=command.linear, angular=command.angular)
        self._target, self._accepted_at = self.caps(now).clamp(asked, fresh.scale), now
        return CommandVerdict(None, fresh.age, self._target, fresh.scale)

    def tick(self, now: float, wanted: Velocity | None = None) -> Decision:
        """Return what the base is to do now. Call at 50 Hz, and once after each accepted command or
        stop.

        `wanted` is what the agent's own navigation wants; without it, navigation is the RCA's and
        hears nothing from here.
        """
        if self._hold is not None and self.leases.live(now) is None and self._hold.is_nobodys(now):
            self._hold = None
        self._now = now
        self._watch_navigation(now)
        self._watch_standstill(now)
        halted = self.latch or self.fault or self.held
        if self.navigation and self.navigation.may_begin and not halted:
            return self._hand_over() if wanted is None else self._navigated(wanted, now)
        why = self.braking(now)
        if why:
            self._target = ZERO
        return self._output(self._target, why or "driving", now)

    def applied(self, velocity: Velocity) -> None:
        """Take note of what the base was really told, where that is not what it was to be told:
        ramps go on from there.
        """
        if velocity != self._current:
            self._own, self._current = no_faster(self._own, velocity), velocity

    def measured(self, velocity: Velocity, now: float) -> None:
        """Take note of how the robot really moves."""
        self._motion = velocity
        if _moves(velocity):
            self._still_since = None
            self._restless = self._restless or self.latch is not None
        elif self._still_since is None:
            self._still_since = now

    def touched(self, sides: Collection[Side] = ()) -> None:
        """Take note of a contact: stop, end the RCA's own travel, and go no further towards it;
        without a side it is where the robot was going.
        """
        forward = self._motion.linear if self.commanded.linear == 0.0 else self.commanded.linear
        if not sides and forward != 0.0:
            sides = ["ahead" if forward > 0.0 else "behind"]
        self.contacts.felt(sides)
        self._target = ZERO
        self._restless = True
        # a station is there to be touched
        if self._hands_off and self.navigation and self.navigation.mode != "docking":
            self._cancel_navigation("collision")

    @property
    def stands(self) -> bool:
        """Tell whether the robot was measured to stand since it was last moved."""
        return not self._restless

    def runs_on(self, now: float) -> bool:
        """Tell whether the robot moves although it should have come to a stand for long."""
        since = self._told_to_stand_at
        return since is not None and _moves(self._motion) and now - since > KERNEL.runs_on_after

    def caps(self, now: float) -> Caps:
        """Return the largest speeds allowed now: the least of robot, lease and assistance."""
        lease = self.leases.live(now)
        # A collision monitor, ours or the RCA's, slows the robot down by itself, and better: it
        # knows where the obstacle is.
        level = (
            "off"
            if self.monitor is not None or "assist" in self.capabilities
            else self.assist.level
        )
        return caps(
            self.limits,
            lease.limits if lease else None,
            assist_speed(level, self.assist.clearance, self.limits),
        )

    def inhibited(self, now: float) -> str | None:
        """Return why velocity commands cannot move the robot now, or not everywhere, in one word,
        or None.
        """
        return self._barred(now) or ("collision" if self.contacts else None)

    def braking(self, now: float) -> str | None:
        """Return why the base is to stand still now, or None while it is being driven."""
        if reason := self._barred(now):
            return reason
        if self._yields or self.navigation:
            return "settling"
        return "deadman" if now >= self._accepted_at + self.limits.deadman else None

    def deadline(self) -> float | None:
        """Return the moment at which the deadman will strike, None while nothing moves."""
        return self._accepted_at + self.limits.deadman if self._target != ZERO else None

    @property
    def held(self) -> bool:
        """Tell whether a stop, or what counts as one, waits for the driver to let go."""
        return self._hold is not None

    def visitor_silence(self, now: float) -> float | None:
        """Return how many seconds ago the visitor was heard, who drives unless a wizard does; None
        without a live lease.
        """
        return (
            now - self.visitor_heard
            if self.visitor_heard is not None and self.leases.live(now)
            else None
        )

    @property
    def commanded(self) -> Velocity:
        """Return the velocity that the base was last told."""
        return self._current

    # --- stop -------------------------------------------------------------------------------------

    def stop(self, action: Stop, sender: CommandSender, now: float) -> bool:
        """Brake. Return False when it only repeats a stop that was obeyed, and the driver has gone
        on since.
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
            self._hold_on(now)
        self._halt("stopped", now)
        return True

    def brake(self, now: float) -> None:
        """Brake for a reason of the agent's own, and wait until the driver has let go."""
        self._hold_on(now)
        self._halt("stopped", now)

    def estop(self, action: EStop, sender: CommandSender, *, now: float, unix: float) -> bool:
        """Brake, and latch for whoever is answerable: one that only watches stops. Return False
        when it only repeats one that was obeyed.
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
        user = (
            action.user if sender.way == "mqtt" else lease.who if lease and role == "driver" else ""
        )
        self._press(EStopLatch(role, unix, user, action.detail), now)
        return True

    def button(self, *, pressed: bool, now: float, unix: float) -> bool:
        """Take the state of the robot's own emergency button; return True when it has just been
        pressed.
        """
        newly, self.button_pressed = pressed and not self.button_pressed, pressed
        if newly:
            self._press(EStopLatch(BUTTON, unix), now)
        return newly

    def set_fault(self, reason: str) -> None:
        """The base cannot be reached, or must not be: nothing moves it until `clear_fault`."""
        self.fault = reason
        self._cancel_navigation("fault")
        self._target = ZERO

    def clear_fault(self, now: float) -> None:
        """The base is back, standing."""
        self.fault = None
        self._hold_on(now)
        self._own = self._current = self._target = ZERO
        self._unsettle()

    # --- actions ----------------------------------------------------------------------------------

    def permit(
        self, action: Action, sender: CommandSender, *, now: float, unix: float
    ) -> str | None:
        """Return in one word why an action (other than stop and estop) is refused, and count it;
        None when it may be done.
        """
        reason = self._why_not(action, sender, now=now, unix=unix)
        if reason:
            self.refused[reason] += 1
        return reason

    def clear_estop(self, now: float) -> None:
        """Open the latch, for a clear_estop that `permit` has let pass."""
        if self.latch is not None:
            self.latch = None
            self._hold_on(now)

    def navigate(self, action_id: str, mode: Mode, *, ordered_by_server: bool, now: float) -> None:
        """The robot is to move by itself, as soon as it stands: `navigation.may_begin` then."""
        self._cancel_navigation("replaced")
        self.navigation = Navigation(action_id, mode, ordered_by_server, now)
        self._target = ZERO

    def navigation_ended(self, action_id: str) -> bool:
        """The robot has come to the end of what it did by itself; return False when it was not
        doing that.
        """
        if self.navigation is None or self.navigation.action_id != action_id:
            return False
        self._leave_navigation(ZERO)
        return True

    def cancel(self, action_id: str | None) -> str | None:
        """Cancel the navigation named, or whatever runs; return its id, None when
        there was none.
        """
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
        """Return why a valid command of the driver moves nothing; a zero lets go of a hold and
        leaves a planner alone.
        """
        if self.latch:
            return "estop"
        if self.fault:
            return "fault"
        if moving:
            return "stopped" if self._hold is not None else None
        return "navigating" if self.navigation else None

    def _barred(self, now: float) -> str | None:
        """Return why nobody may drive the robot now, in one word, or None."""
        if self.latch:
            return "estop"
        if self.fault:
            return "fault"
        if self._hold is not None:
            return "stopped"
        return None if self.leases.live(now) else "no_lease"

    def _clock_of_driver(self, lease: Lease) -> PeerClock | None:
        return self.clocks.of(lease.driver) if lease.driver is not None else None

    def _why_not(
        self, action: Action, sender: CommandSender, *, now: float, unix: float
    ) -> str | None:
        lease = self.leases.live(now)
        reason = refusal(action, sender, lease, self.capabilities) or staleness(
            action, sender, lease, self.clocks, now=now, unix=unix
        )
        if reason:
            return reason
        if isinstance(action, ClearEStop):
            return latch_refusal(self.latch, action, button_pressed=self.button_pressed)
        if not isinstance(action, MOVING):
            return None
        if self.latch:
            return "estop"
        return "fault" if self.fault else "stopped" if self._hold is not None else None

    def _press(self, latch: EStopLatch, now: float) -> None:
        self.latch = stricter(self.latch, latch)
        self._halt("estop", now)

    def _halt(self, reason: str, now: float) -> None:
        self._now = now
        self._cancel_navigation(reason)
        self._target, self._accepted_at = ZERO, float("-inf")
        self._unsettle()

    def _cancel_navigation(self, reason: str) -> None:
        if self.navigation:
            self.cancelled.append((self.navigation.action_id, reason))
            self._leave_navigation(self._motion)

    def _leave_navigation(self, speed: Velocity) -> None:
        """Brake from the speed at which the RCA has left the robot."""
        self.navigation = None
        if self._hands_off:
            self._own = self._current = self.caps(self._now).clamp(speed)
            self._output_at, self._hands_off = self._now, False
            self._yields = True
            self._unsettle()

    def _watch_standstill(self, now: float) -> None:
        """Note when a robot that may have been moving stands."""
        if self._current != ZERO or self._hands_off:
            self._unsettle()
        elif self._still_since is not None and now - self._still_since >= KERNEL.stands_for:
            self._restless = self._yields = False
            if self.navigation and not self.navigation.may_begin:
                self.navigation = replace(self.navigation, may_begin=True)
        if self._current != ZERO or self._hands_off or not self._restless:
            self._told_to_stand_at = None
        elif self._told_to_stand_at is None:
            self._told_to_stand_at = now

    def _unsettle(self) -> None:
        """The robot may be moving: it stands when it has been measured so from now on."""
        self._restless, self._still_since = True, None

    def _hold_on(self, now: float) -> None:
        self._hold = DriveHold(_grant(self.leases.live(now)), self._driven_by, now)

    def _watch_navigation(self, now: float) -> None:
        running = self.navigation
        if running is None or running.ordered_by_server:
            return
        if self.leases.live(now) is None:
            self._cancel_navigation("no_lease")
        elif (
            now - max(running.since, self.driver_heard or running.since)
            >= KERNEL.navigation_silence
        ):
            self._cancel_navigation("heartbeat_lost")

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
        # what the robot has lost of the speed at which it was left, it is not given again
        if self._yields:
            self._own = self._current = no_faster(self._current, self._motion)
        if self._current == ZERO and not self._restless:
            return Decision(None, "idle")
        self._output_at = now
        return Decision(self._current, why)

    def _hand_over(self) -> Decision:
        """Be silent: the RCA moves the robot."""
        self._hands_off = True
        self._unsettle()
        return Decision(None, "navigating")

    def _navigated(self, wanted: Velocity, now: float) -> Decision:
        """Return what the agent's own navigation gets: its wish within limits and ramps, and zeros
        too, for they hold it in its place.
        """
        self._hands_off = False
        self._approach(wanted, now)
        self._output_at = now
        return Decision(self._current, "navigating")

    def _approach(self, target: Velocity, now: float, *, shaped: bool = False) -> None:
        """Let a target pass limits, collision monitor (when it is to be `shaped`) and ramp."""
        since = now - self._output_at
        if since > min(self.limits.deadman, self.watchdog):
            # So long without a word from us the base has stopped by itself; going on from the old
            # speed would start it again.
            self._own = self._current = ZERO
        self.contacts.moved(self._current.linear * min(since, KERNEL.max_step))
        step = min(since, KERNEL.max_step)
        allowed = self._limited(target, now)
        if shaped and self.monitor is not None and self.assist.level != "off":
            allowed = self._shaped(ramp(self._own, allowed, self.limits, dt=since, dt_up=step), now)
            self._current = ramp(self._current, allowed, self.limits, dt=since, dt_up=step)
        else:  # who brakes stays on the course that was looked at when it was begun
            self._own = self._current = ramp(
                self._current, allowed, self.limits, dt=since, dt_up=step
            )

    def _limited(self, velocity: Velocity, now: float) -> Velocity:
        return self.caps(now).clamp(self.contacts.clamp(velocity))

    def _shaped(self, wanted: Velocity, now: float) -> Velocity:
        """Return what the collision monitor leaves of a velocity, inside the limits."""
        assert self.monitor is not None
        found = self.monitor.shape(wanted, self._current, self.assist.level, now)
        allowed = self._limited(found.velocity, now)
        # a turn that was added is too much for a limit: less of it leads elsewhere, so look once
        # more
        if allowed != found.velocity:
            found = self.monitor.shape(allowed, self._current, "slow", now)
        self._own = found.own
        return found.velocity


def _moves(measured: Velocity) -> bool:
    return (
        abs(measured.linear) > KERNEL.standstill
        or abs(measured.angular) > KERNEL.standstill_turning
    )


def _grant(lease: Lease | None) -> LeaseGrant | None:
    return (lease.session, lease.epoch, lease.wizard_epoch) if lease else None
