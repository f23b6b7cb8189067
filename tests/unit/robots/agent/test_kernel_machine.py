"""Search the safety kernel for sequences of events that break a promise: it never raises, never
exceeds a limit, never drives without a live lease and a recent command, and obeys every stop.

The model has a base that executes the last velocity it was sent, or drives as its own architecture
does: that architecture may accept an action late, reject it, ignore a cancel, drive on after it was
at rest, and restart. A much simpler account of permissions is kept beside the kernel.
`pytest --hypothesis-profile=search` tries other sequences.
"""

import math

from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from robots.agent.ramp import ZERO
from robots.agent.safety.clock_sync import SERVER_PEER
from robots.agent.safety.collision.assist import Assisted
from robots.agent.safety.contacts import CREEP, SIDES
from robots.agent.safety.controllers import Controller
from robots.agent.safety.estop_latch import BUTTON
from robots.agent.safety.kernel import KERNEL, STANDSTILL, Kernel
from robots.agent.safety.lease import Remembered
from robots.agent.safety.permissions import CommandSender
from robots.api import messages as m
from tests.support.agents.kernel_bench import DRIVER_CLOCK, LIMITS, TICK, Bench
from tests.support.examples import examples, repetitions

SLACK = 1e-9
GOING = m.Velocity(linear=0.5, angular=0.2)  # of an architecture that drives by itself
RELEASED_AFTER = 1.0  # s without a velocity, while heartbeats arrive
LEASE_TTL = 10.0  # s
# s from the fastest speeds to rest
BRAKING = max(LIMITS.linear / LIMITS.linear_braking, LIMITS.angular / LIMITS.angular_braking)

speeds = st.sampled_from([0.0, 0.0, 0.7, 0.3, -0.4, 5.0, -5.0]) | st.floats(-10.0, 10.0)
peers = st.sampled_from(["p1", "p2"])
roles = st.sampled_from(["driver", "observer", "screen", "staff", "owner", "server"])
ways = st.sampled_from(["datachannel", "mqtt"])
numbers = st.integers(0, 5)
levels = st.sampled_from(["steer", "slow", "off"])
speeds_allowed = st.sampled_from([math.inf, 0.1, 0.0])
turns = st.sampled_from([0.35, -0.35, 0.0])


def moves(velocity):
    return abs(velocity.linear) > STANDSTILL.linear or abs(velocity.angular) > STANDSTILL.angular


class Walls:
    """A collision monitor that allows given speeds (m/s) ahead and back and adds a turn (rad/s)."""

    def __init__(self):
        self.ahead = self.back = math.inf
        self.turn = 0.0

    def shape(self, wanted, told, level, now):
        assert level != "off"
        linear = min(max(wanted.linear, -self.back), self.ahead)
        own = m.Velocity(linear=linear, angular=wanted.angular)
        turn = self.turn if level == "steer" and linear > 0.0 else 0.0
        return Assisted(m.Velocity(linear=linear, angular=own.angular + turn), "free", own=own)


class KernelMachine(RuleBasedStateMachine):
    """One robot; `base` is its real velocity."""

    def __init__(self):
        super().__init__()
        self.walls = Walls()
        self.bench = Bench(monitor=self.walls)
        self.kernel = self.new_kernel()
        self.base, self.told, self.told_at = ZERO, ZERO, -math.inf
        self.goes = self.obeys = False  # the architecture drives; it would take a cancel
        self.was_begun = False  # the architecture has an action that it has not ended
        self.fights = False  # it drove on while the driver was driving
        self.unbidden_for = 0  # ticks for which it has moved the robot against zeros
        self.too_fast_for = 0  # ticks for which it has driven faster than the limits
        self.server_beat_at = -math.inf
        self.lags = False  # the adapter delays velocities until the base has answered
        self.own = False
        self.latched = False
        self.pressed_at = {}  # by kind and number
        self.held = self.by_person = False  # a stop waits for its release; a person's stop
        self.quiet_since = self.beat_at = -math.inf
        self.epoch = self.renewal = 0
        self.caps = m.LeaseLimits()
        self.faulty = False
        self.taken = -1  # the highest number accepted by this run of the agent under this lease
        self.lease_until = self.accepted_at = -math.inf  # end of the lease, last accepted command
        self.braked_for = 0.0  # s
        self.presses = 0  # of stops that are no copies

    @property
    def now(self):
        return self.bench.now

    def new_kernel(self, **remembered):
        bench = self.bench
        bench.kernel = Kernel(
            LIMITS, bench.watchdog, bench.capabilities, monitor=self.walls, **remembered
        )
        return bench.kernel

    @property
    def is_held(self):
        return self.held and (self.by_person or self.kernel.leases.live(self.now) is not None)

    @initialize(
        level=levels,
        angular=st.sampled_from([0.2, None]),
        ahead=speeds_allowed,
        back=speeds_allowed,
        turn=turns,
    )
    def begins(self, level, angular, ahead, back, turn):
        self.grants(known=True, angular=angular)
        self.is_helped(level)
        self.obstacles_change(ahead, back, turn)
        self.releases_the_keys()

    # --- leases -----------------------------------------------------------------------------------

    @rule(
        known=st.just(True),
        ttl=st.sampled_from([0.3, 10.0]),
        linear=st.sampled_from([None, 0.2]),
        angular=st.sampled_from([None, 0.2]),
    )
    def grants(self, known, ttl=10.0, linear=None, angular=None):
        self.epoch, self.renewal = self.epoch + 1, 0
        self.caps = m.LeaseLimits(linear=linear, angular=angular)
        self.bench.lease(session=f"s{self.epoch}", epoch=self.epoch, ttl=ttl, limits=self.caps)
        self.lease_until = self.now + ttl
        if known:
            self.bench.know_clock()
            self.beats(self.now)
        self.held = self.by_person = False  # the driver who may hold a key has left
        self.taken = -1

    @rule(linear=st.sampled_from([None, 0.1, 0.5]))
    def renews(self, linear):
        self.renewal, self.caps = self.renewal + 1, m.LeaseLimits(linear=linear)
        self.leases(self.caps)
        self.lease_until = self.now + LEASE_TTL

    def leases(self, limits):
        """Send the lease of the session with its current renewal."""
        session = f"s{self.epoch}"
        self.bench.lease(session=session, epoch=self.epoch, renewal=self.renewal, limits=limits)

    @rule(linear=st.sampled_from([0.05, 0.15]))
    def lowers(self, linear):
        if self.kernel.leases.live(self.now) is not None:
            self.caps = m.LeaseLimits(linear=min(linear, self.caps.linear or math.inf))
        self.leases(m.LeaseLimits(linear=linear))

    @rule(back=st.integers(1, 3), retained=st.booleans())
    def an_old_lease_comes(self, back, retained):
        before = self.kernel.leases.live(self.now)
        old = max(0, self.epoch - back)
        self.bench.lease(session=f"s{old}", epoch=old, renewal=9, retained=retained)
        after = self.kernel.leases.live(self.now)
        assert before is None or after is None or after.epoch == before.epoch
        if after is not None and after.epoch != self.epoch:  # the server's counter was reset
            self.epoch, self.renewal, self.caps = after.epoch, 9, m.LeaseLimits()
            self.held, self.by_person, self.taken = False, False, -1
            self.lease_until = self.now + LEASE_TTL

    @rule()
    def takes_the_lease_back(self):
        self.bench.end_lease()
        self.lease_until = -math.inf

    def beats(self, now, way="datachannel"):
        if now - self.beat_at > 0.5:
            self.quiet_since = max(self.quiet_since, now)
        self.beat_at = now
        self.kernel.heartbeat("p1", way, now)
        lease = self.kernel.leases.live(now)
        if lease is not None and now - self.quiet_since >= RELEASED_AFTER - SLACK:
            self.held = False

    @rule(way=ways, seconds=st.sampled_from([0.2, 1.3]))
    def driver_beats(self, way, seconds):
        for _ in range(round(seconds / 0.2)):
            self.passes(10)
            self.beats(self.now, way)

    @rule()
    def server_beats(self):
        self.server_beat_at = self.now
        self.kernel.heartbeat(SERVER_PEER, "mqtt", self.now)

    # --- velocities -------------------------------------------------------------------------------

    @rule(
        linear=speeds,
        angular=speeds,
        way=ways,
        late=st.sampled_from([0.0, 0.0, 0.2, 0.4]),
        times=st.integers(1, 8),
    )
    def drives(self, linear, angular, way, late, times):
        for _ in range(times):
            command = self.bench.command(
                linear, angular, age=late, session=f"s{self.epoch}", epoch=self.epoch
            )
            moving = bool(linear or angular)
            verdict = self.kernel.velocity(
                command, CommandSender(way, "p1"), now=self.now, unix=self.bench.unix
            )
            if moving:
                self.quiet_since = self.now
                assert verdict.reason is not None or not self.is_held, "the key was never released"
            elif verdict.reason in {None, "navigating", "estop", "fault"}:
                self.held = False
            if verdict.reason in {None, "navigating", "estop", "fault", "stopped"}:
                self.taken = command.seq
            if verdict.reason is None:
                assert not self.latched
                assert not self.faulty
                assert self.now < self.lease_until
                self.accepted_at = self.now
            self.passes(3)

    @rule(linear=speeds, peer=peers, back=st.integers(0, 3))
    def an_old_copy_comes(self, linear, peer, back):
        if self.taken < back and peer == "p1":
            return
        command = self.bench.command(
            linear, session=f"s{self.epoch}", epoch=self.epoch, seq=max(0, self.taken - back)
        )
        sender = CommandSender("datachannel", peer)
        verdict = self.kernel.velocity(command, sender, now=self.now, unix=self.bench.unix)
        assert verdict.reason is not None

    def releases_the_keys(self):
        self.drives(0.0, 0.0, "datachannel", 0.0, 1)

    # --- assistance -------------------------------------------------------------------------------

    @rule(level=levels)
    def is_helped(self, level):
        self.kernel.assist.level = level

    @rule(ahead=speeds_allowed, back=speeds_allowed, turn=turns)
    def obstacles_change(self, ahead, back, turn):
        self.walls.ahead, self.walls.back, self.walls.turn = ahead, back, turn

    # --- stops ------------------------------------------------------------------------------------

    @rule(way=ways, peer=peers, role=roles, number=numbers)
    def stops(self, way, peer, role, number):
        self.presses_stop(way, peer, role, number)

    @rule(way=ways, peer=peers, role=roles)
    def a_stop_that_is_no_copy_brings_it_to_rest(self, way, peer, role):
        self.presses += 1
        assert self.presses_stop(way, peer, role, f"press-{self.presses}")
        self.passes(round((BRAKING + KERNEL.at_rest_for) / TICK) + 3)
        assert self.told == ZERO

    def presses_stop(self, way, peer, role, number):
        own = (way == "datachannel" and peer == "p1") or (way == "mqtt" and role == "driver")
        own = own and self.kernel.leases.live(self.now) is not None
        self.bench.seq += 1
        sender = {"way": way, "peer": peer, "role": role}
        drive = {"seq": self.bench.seq, "session": f"s{self.epoch}", "epoch": self.epoch}
        obeyed = self.bench.stop(action_id=f"id-{number}", **sender, **drive)
        assert self.kernel.stop_id == f"id-{number}"
        if obeyed:
            self.pressed_at["stop", number] = self.now
            assert self.kernel.navigation is None
            self.navigation_is_over()
            if not own:
                self.hold(by_person=self.kernel.leases.live(self.now) is not None)
        self.sees(self.bench.outputs[-1][1])
        return obeyed

    @rule(way=ways, role=roles, number=numbers)
    def is_stopped_for_good(self, way, role, number):
        watches = way == "datachannel" or role == "observer"
        press = ("stop" if watches else "estop", number)
        if self.bench.estop(action_id=f"id-{number}", way=way, peer="p2", role=role):
            self.pressed_at[press] = self.now
            if watches:
                self.hold(by_person=True)
            else:
                self.latched = True
            self.navigation_is_over()
        else:
            assert self.now - self.pressed_at.get(press, -math.inf) < KERNEL.same_stop, (
                "an e-stop that repeats none was not obeyed"
            )
        self.sees(self.bench.outputs[-1][1])

    @rule(pressed=st.booleans())
    def a_button(self, pressed):
        if self.kernel.button(pressed=pressed, now=self.now, unix=self.bench.unix):
            self.latched = True
            self.navigation_is_over()

    @rule(
        role=st.sampled_from(["driver", "observer", "screen", "staff", "owner"]),
        user=st.sampled_from(["", "ops"]),
    )
    def clears_the_estop(self, role, user):
        latch, pressed = self.kernel.latch, self.kernel.button_pressed
        clear = m.ClearEStop(action_id="c", stamp=self.bench.unix, role=role, user=user)
        if self.bench.ask(clear) is not None:
            return
        assert not pressed
        assert role in {"screen", "staff", "owner"}
        assert user
        assert latch is None or latch.source != BUTTON or role == "owner"
        has_driver = self.kernel.leases.live(self.now) is not None
        self.kernel.clear_estop(self.now)
        if self.latched:
            self.hold()
        elif not has_driver:
            self.held = self.by_person = False
        self.latched = False

    def hold(self, *, by_person=False):
        if self.kernel.leases.live(self.now) is not None or by_person:
            self.by_person = by_person or (self.held and self.by_person)
            self.held = True
            self.quiet_since = self.beat_at = self.now

    # --- navigation -------------------------------------------------------------------------------

    @rule(own=st.booleans(), obeys=st.booleans(), server=st.booleans())
    def is_sent_somewhere(self, own, obeys, server):
        self.navigation_is_over()
        self.bench.navigate("g", by_server=server)
        self.own, self.obeys = own, obeys
        self.bench.wanted = GOING if own else None

    @rule(linear=speeds, angular=speeds)
    def wishes(self, linear, angular):
        if self.own and self.kernel.navigation:
            self.bench.wanted = m.Velocity(linear=linear, angular=angular)

    @precondition(lambda self: self.kernel.navigation is not None)
    @rule(by_itself=st.booleans())
    def arrives_or_is_cancelled(self, by_itself):
        if by_itself:
            self.goes = self.was_begun = False
            self.kernel.navigation_ended("g")
        else:
            self.kernel.cancel("g")
        self.navigation_is_over()

    @rule()
    def architecture_waits_or_gives_up(self):
        self.goes = False

    @precondition(lambda self: self.was_begun)
    @rule()
    def architecture_begins_late_or_goes_on(self):
        """It accepts late, ignores its cancel, or drives on after it was at rest."""
        self.goes = True
        self.fights = self.fights or self.kernel.controller is Controller.DRIVER

    @rule()
    def architecture_confirms_or_dies(self):
        if self.kernel.navigation is None:
            self.goes = self.was_begun = self.kernel.is_end_unconfirmed = False
            self.fights = False

    def navigation_is_over(self):
        self.bench.wanted, self.own = None, False
        if self.obeys:
            self.goes = self.was_begun = False
        self.kernel.is_end_unconfirmed = self.was_begun

    # --- faults -----------------------------------------------------------------------------------

    @rule(broken=st.booleans())
    def its_base_is(self, broken):
        if broken:
            self.kernel.set_fault("adapter_lost")
            self.navigation_is_over()
        elif self.faulty:
            self.kernel.clear_fault(self.now)
            self.told = ZERO
            self.hold()
        self.faulty = self.kernel.fault is not None

    @rule(lags=st.booleans())
    def adapter_holds_velocities_back(self, lags):
        self.lags = lags

    @rule(sides=st.sets(st.sampled_from(SIDES), max_size=2))
    def touches_something(self, sides):
        self.kernel.touched(sides)

    @rule()
    def its_agent_begins_anew(self):
        lease, latch = self.kernel.leases.newest, self.kernel.latch
        newest = lease and Remembered(lease.session, lease.epoch, lease.renewal, lease.stamp)
        level = self.kernel.assist.level
        self.kernel = self.new_kernel(latch=latch, newest_lease=newest)
        self.kernel.assist.level = level
        assert (self.kernel.latch is not None) == self.latched
        self.faulty = False
        self.navigation_is_over()
        self.held = self.by_person = False
        self.told, self.told_at, self.taken = ZERO, -math.inf, -1
        self.unbidden_for = 0
        self.pressed_at = {}
        self.renews(self.caps.linear)
        self.bench.know_clock()
        self.hold()

    @rule(step=st.sampled_from([-3600.0, -0.3, 0.3, 3600.0]))
    def the_clock_of_a_page_steps(self, step):
        beat = self.kernel.clocks.beat(self.now, self.bench.unix)
        there = self.bench.unix + DRIVER_CLOCK + step
        echo = m.Echo(peer="robot", n=beat.n, stamp=beat.stamp, received=there)
        answer = m.CommandHeartbeat(n=beat.n, stamp=there, peer="p1", echo=echo)
        self.kernel.clocks.on_heartbeat("p1", "mqtt", answer, now=self.now, unix=self.bench.unix)

    @rule(seconds=st.sampled_from([0.05, 0.29, 0.6, 1.05, 3.0]))
    def loop_is_held_up(self, seconds):
        """The loop does not run: only the base's watchdog acts."""
        self.bench.now += seconds
        self.base_moves()
        self.passes(1)

    @rule(ticks=st.sampled_from([1, 5, 20, 60]))
    def passes(self, ticks):
        for _ in range(ticks):
            self.bench.now += TICK
            self.base_moves()
            self.kernel.measured(self.base, self.now)
            running = self.kernel.navigation
            decision = self.kernel.tick(self.now, self.bench.wanted)
            if self.kernel.navigation is None and running is not None:
                self.navigation_is_over()
            self.sees(decision)
            self.counts_speed_of_the_architecture()

    def base_moves(self):
        silent = self.now - self.told_at > self.bench.watchdog
        self.base = self.bench.motion = GOING if self.goes else ZERO if silent else self.told

    # --- promises ---------------------------------------------------------------------------------

    def sees(self, decision):
        """Check a decision, and pass it to the base."""
        velocity = decision.velocity
        if velocity is None:
            self.sees_silence(decision)
            return
        self.counts_unbidden_motion(velocity)
        before = last_sent = self.told
        if moves(self.base) and before == ZERO:
            before = self.base  # as the architecture has left it
        drives = decision.why in {"driving", "navigating"}
        against = self.goes and decision.why == "driving" and velocity != ZERO
        assert not against or self.fights, "a driver drives against an architecture"
        largest = LIMITS.linear if velocity.linear > 0 else LIMITS.reverse
        for old, new, limit, up in (
            (before.linear, velocity.linear, largest, LIMITS.linear_acceleration),
            (before.angular, velocity.angular, LIMITS.angular, LIMITS.angular_acceleration),
        ):
            assert abs(new) <= limit + SLACK
            if drives:
                from_speed = abs(old) if old * new > 0.0 else 0.0
                grown = up * min(self.now - self.told_at, KERNEL.max_step)
                assert abs(new) <= from_speed + grown + SLACK
            else:
                fastest = abs(old)
                if self.was_begun or self.goes:  # the architecture may have moved it
                    fastest = max(fastest, abs(self.base.angular), abs(self.base.linear))
                assert abs(new) <= fastest + SLACK
                assert new * old >= 0.0
        if self.latched or self.faulty or self.is_held:
            assert not drives
        if decision.why == "driving":
            assert self.now < min(self.accepted_at + LIMITS.deadman, self.lease_until)
        is_braking = not drives and not self.goes
        self.braked_for += min(self.now - self.told_at, TICK) if is_braking else -self.braked_for
        assert velocity == ZERO or self.braked_for <= BRAKING + 2 * TICK
        if drives:
            self.keeps_to_limits(velocity, before)
            self.moves_away_from_contacts(velocity, before)
        if (
            decision.why == "driving"
            and self.kernel.assist.level != "off"
            and self.now > self.told_at
            and velocity.linear * before.linear >= 0.0
        ):
            allowed = self.walls.ahead if velocity.linear > 0.0 else self.walls.back
            slowest = abs(before.linear) - self.braked(LIMITS.linear_braking)
            assert abs(velocity.linear) <= max(allowed, slowest) + SLACK, "too fast to an obstacle"
        self.told, self.told_at = velocity, self.now
        # An adapter that delays a velocity sends it after the kernel has asked for the last one.
        self.kernel.applied(last_sent if self.lags and velocity != ZERO else velocity)

    def braked(self, braking):
        """Return by how much the base must at least have braked since the last decision."""
        return braking * min(self.now - self.told_at, TICK) * 0.5

    def keeps_to_limits(self, velocity, before):
        if self.kernel.leases.live(self.now) is None:
            return
        for new, old, cap, braking in (
            (velocity.linear, before.linear, self.caps.linear, LIMITS.linear_braking),
            (velocity.angular, before.angular, self.caps.angular, LIMITS.angular_braking),
        ):
            if cap is not None:
                assert abs(new) <= max(cap, abs(old) - self.braked(braking)) + SLACK

    def moves_away_from_contacts(self, velocity, before):
        sides = set(self.kernel.contacts.sides)
        between = CREEP if {"ahead", "behind"} <= sides else 0.0
        for side, sign in (("ahead", 1.0), ("behind", -1.0)):
            slowest = sign * before.linear - self.braked(LIMITS.linear_braking)
            towards = sign * velocity.linear
            assert side not in sides or towards <= max(between, slowest) + SLACK

    def sees_silence(self, decision):
        running = self.kernel.navigation
        handed_over = running is not None and running.may_begin and self.bench.wanted is None
        assert handed_over or not moves(self.base), (
            f"no controller, and the robot is left moving: {decision.why}"
        )
        assert handed_over or not self.kernel.is_end_unconfirmed, "no zeros"
        if handed_over and not self.was_begun:
            assert not moves(self.base), "an architecture begins with a moving robot"
            self.goes = self.was_begun = True
        self.unbidden_for = 0

    def counts_speed_of_the_architecture(self):
        caps = self.kernel.caps(self.now)
        is_too_fast = (
            self.kernel.controller is Controller.RCA
            and self.goes
            and (GOING.linear > 1.1 * caps.linear or GOING.angular > 1.1 * caps.angular)
        )
        self.too_fast_for = self.too_fast_for + 1 if is_too_fast else 0
        assert self.too_fast_for * TICK <= KERNEL.overspeed_for + 3 * TICK

    def counts_unbidden_motion(self, velocity):
        is_unbidden = moves(self.base) and velocity == ZERO == self.told and not self.own
        self.unbidden_for = self.unbidden_for + 1 if is_unbidden else 0
        if self.unbidden_for * TICK > 0.5:
            assert self.kernel.moves_despite_stop(self.now), "the motion is not reported"

    @invariant()
    def a_latch_is_released_by_nothing_but_its_release(self):
        assert (self.kernel.latch is not None) == self.latched

    @invariant()
    def what_the_server_ordered_ends_without_its_heartbeats(self):
        running = self.kernel.navigation
        if running is not None and running.ordered_by_server and self.now == self.kernel._now:
            silence = self.now - max(running.since, self.server_beat_at)
            assert silence < KERNEL.navigation_silence

    @invariant()
    def what_cannot_move_says_why(self):
        if self.latched or self.faulty:
            assert self.kernel.inhibited(self.now) in {"estop", "fault"}


class DrivenMachine(KernelMachine):
    """Without events that end a drive for long, so that most steps drive."""

    is_stopped_for_good = a_button = its_base_is = takes_the_lease_back = an_old_lease_comes = None
    its_agent_begins_anew = loop_is_held_up = the_clock_of_a_page_steps = is_sent_somewhere = (
        wishes
    ) = architecture_begins_late_or_goes_on = None

    @rule(linear=st.sampled_from([0.7, 0.7, -0.4]), angular=speeds, times=st.integers(4, 12))
    def goes_on(self, linear, angular, times):
        self.drives(linear, angular, "datachannel", 0.0, times)


TestKernelMachine = KernelMachine.TestCase
TestKernelMachine.settings = examples(
    60, thorough=2000, stateful_step_count=repetitions(50, thorough=100)
)
TestDrivenMachine = DrivenMachine.TestCase
TestDrivenMachine.settings = examples(40, thorough=1000, stateful_step_count=30)
