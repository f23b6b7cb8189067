"""With any events in any order the kernel never raises, never exceeds a limit, and never moves the
robot without a live lease.

Programs of random events with random gaps run against the kernel, beside an independent and much
simpler account of permissions.
"""

import math

import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from robots.agent.ramp import ZERO
from robots.agent.safety.kernel import KERNEL
from robots.agent.safety.permissions import CommandSender
from robots.api import messages as m
from tests.support.agents.kernel_bench import LIMITS, Bench, bench_with_driver
from tests.support.examples import examples

pytestmark = pytest.mark.long

SLACK = 1e-9


def cases(ordinary, thorough):
    return examples(ordinary, thorough=thorough, suppress_health_check=list(HealthCheck))


epochs = st.integers(0, 3)
sessions = st.sampled_from(["s1", "s2"])
peers = st.sampled_from(["p1", "p2"])
ways = st.sampled_from(["datachannel", "mqtt"])
roles = st.sampled_from(["driver", "observer", "screen", "staff", "owner", "server"])
speeds = st.one_of(st.just(0.0), st.floats(-10, 10), st.sampled_from([0.3, 0.7, -0.4]))
optional_limits = st.one_of(st.none(), st.floats(0.05, 5.0))

leases = st.tuples(
    st.just("lease"),
    sessions,
    epochs,
    peers,
    st.integers(0, 5),
    st.booleans(),
    optional_limits,
    st.floats(0.1, 12.0),
    st.sampled_from(["required", "none"]),
)
velocities = st.tuples(
    st.just("velocity"),
    sessions,
    epochs,
    peers,
    ways,
    st.integers(-3, 3),
    speeds,
    speeds,
    st.floats(-1, 1.5),
    st.floats(-1, 4),
)
good_velocities = st.tuples(st.just("good"), speeds, speeds)
stops = st.tuples(
    st.just("stop"), ways, peers, roles, sessions, epochs, st.integers(0, 50), st.integers(0, 9)
)
estops = st.tuples(st.just("estop"), ways, peers, roles, st.integers(0, 9))
others = st.one_of(
    st.tuples(st.just("empty")),
    st.tuples(st.just("clear"), ways, roles, st.sampled_from(["", "ops"])),
    st.tuples(st.just("button"), st.booleans()),
    st.tuples(st.just("fault"), st.booleans()),
    st.tuples(st.just("clock"), peers),
    st.tuples(st.just("navigate"), st.booleans()),
    st.tuples(st.just("wait"), st.floats(0.0, 2.5)),
    st.tuples(st.just("grant"), st.sampled_from([0.05, 0.2, 10.0])),
)
gaps = st.sampled_from([0.0, 0.001, 0.02, 0.02, 0.02, 0.05, 0.29, 0.31])
programs = st.lists(
    st.tuples(
        gaps, st.one_of(good_velocities, good_velocities, velocities, leases, stops, estops, others)
    ),
    max_size=30,
)


class Account:
    """Last velocity, last accepted command and end of the lease, independent of the kernel."""

    def __init__(self, bench, lease_until=-math.inf):
        self.bench, self.lease_until, self.latched = bench, lease_until, False
        self.last, self.last_at, self.accepted_at = ZERO, -math.inf, -math.inf

    def check(self):
        bench = self.bench
        decision = bench.tick()
        velocity = decision.velocity
        if velocity is None:
            return
        assert -LIMITS.reverse - SLACK <= velocity.linear <= LIMITS.linear + SLACK
        assert abs(velocity.angular) <= LIMITS.angular + SLACK
        dt = bench.now - self.last_at
        for before, after, up in (
            (self.last.linear, velocity.linear, LIMITS.linear_acceleration),
            (self.last.angular, velocity.angular, LIMITS.angular_acceleration),
        ):
            grows = abs(after) > abs(before) or before * after < 0
            base = abs(before) if before * after > 0 else 0.0
            assert not grows or abs(after) <= base + up * min(dt, KERNEL.max_step) + SLACK
        permitted = bench.now < min(self.accepted_at + LIMITS.deadman, self.lease_until)
        if self.latched or not permitted:
            assert abs(velocity.linear) <= abs(self.last.linear) + SLACK
            assert abs(velocity.angular) <= abs(self.last.angular) + SLACK
            if dt >= 0.0199 and self.last.linear != 0.0:
                braked = abs(self.last.linear) - LIMITS.linear_braking * 0.0199
                assert abs(velocity.linear) <= max(0.0, braked) + SLACK
        self.last, self.last_at = velocity, bench.now


# --- a function for each event, which updates the account -----------------------------------------


def _lease(bench, account, session, epoch, peer, renewal, retained, limit, ttl, video):
    terms = {"ttl": ttl, "video": video, "limits": m.LeaseLimits(linear=limit)}
    names = {"session": session, "epoch": epoch, "peer": peer, "renewal": renewal}
    if bench.lease(**names, **terms, retained=retained):
        if not retained:
            account.lease_until = bench.now + ttl
        elif bench.kernel.leases.live(bench.now) is None:
            account.lease_until = -math.inf


def _grant(bench, account, ttl):
    bench.lease(session="s1", epoch=bench.kernel.leases.newest.epoch + 1, ttl=ttl)
    account.lease_until = bench.now + ttl
    _good(bench, account, 0.7, 0.0)


def _empty(bench, account):
    bench.end_lease()
    account.lease_until = -math.inf


def _velocity(bench, account, session, epoch, peer, way, step, linear, angular, age, frame_age):
    ages = {"age": age, "frame_age": frame_age, "seq": max(0, bench.seq + step)}
    command = bench.command(linear, angular, session=session, epoch=epoch, **ages)
    _send(bench, account, command, CommandSender(way, peer))


def _good(bench, account, linear, angular):
    lease = bench.kernel.leases.live(bench.now)
    session, epoch = (lease.session, lease.epoch) if lease else ("s1", 1)
    command = bench.command(linear, angular, session=session, epoch=epoch)
    _send(bench, account, command, CommandSender("mqtt"))


def _send(bench, account, command, sender):
    verdict = bench.kernel.velocity(command, sender, now=bench.now, unix=bench.unix)
    assert (bench.now < account.lease_until and not account.latched) or verdict.reason
    if verdict.reason is None:
        account.accepted_at = bench.now


def _stop(bench, _account, way, peer, role, session, epoch, seq, number):
    names = {"way": way, "peer": peer, "role": role, "session": session, "epoch": epoch}
    bench.stop(action_id=f"stop-{number}", seq=seq, **names)
    assert bench.kernel.stop_id == f"stop-{number}"


def only_watches(bench, way, peer, role):
    if way == "mqtt":
        return role == "observer"
    lease = bench.kernel.leases.live(bench.now)
    return lease is None or lease.peer != peer


def _estop(bench, account, way, peer, role, number):
    known = ("estop", f"estop-{number}") in bench.kernel._stops
    latched = bench.kernel.latch
    bench.estop(action_id=f"estop-{number}", way=way, peer=peer, role=role)
    assert known or bench.kernel.latch or only_watches(bench, way, peer, role)
    assert latched or not bench.kernel.latch or not only_watches(bench, way, peer, role)
    account.latched = bench.kernel.latch is not None


def _clear(bench, account, way, role, user):
    latch, held = bench.kernel.latch, bench.kernel.held
    between_sessions = bench.kernel.leases.live(bench.now) is None
    clear = m.ClearEStop(action_id="c", stamp=bench.unix, role=role, user=user)
    if bench.ask(clear, way=way, peer="p1") is None:
        assert way == "mqtt"
        # The robot's screen clears its own e-stop, and a stop between sessions.
        is_theirs = latch.source == "screen" if latch else held and between_sessions
        assert role in {"staff", "owner"} or (role == "screen" and is_theirs)
        assert user
        bench.kernel.clear_estop(bench.now)
        account.latched = False


def _button(bench, account, pressed):
    bench.kernel.button(pressed=pressed, now=bench.now, unix=bench.unix)
    account.latched = bench.kernel.latch is not None


def _fault(bench, account, on):
    if on:
        bench.kernel.set_fault("adapter_lost")
    else:
        bench.kernel.clear_fault(bench.now)
        account.last = ZERO


def _clock(bench, _account, peer):
    bench.know_clock(peer)


def _navigate(bench, _account, by_server):
    bench.navigate(by_server=by_server)


def _wait(bench, _account, seconds):
    bench.now += seconds


EVENTS = (_lease, _grant, _empty, _velocity, _good, _stop, _estop, _clear, _button)
EVENTS += (_fault, _clock, _navigate, _wait)
BY_NAME = {event.__name__.lstrip("_"): event for event in EVENTS}


def perform(bench, account, event):
    kind, *values = event
    BY_NAME[kind](bench, account, *values)


@cases(500, thorough=20_000)
@given(programs, st.booleans())
def test_no_program_of_events_exceeds_limits_or_moves_the_robot_without_permission(
    program, driving
):
    bench = Bench()
    bench.lease()
    account = Account(bench, bench.now + 10.0)
    bench.know_clock()
    if driving:
        bench.run(1.6, every=0.1, linear=0.6, angular=-0.6)
        account.last, account.last_at = bench.kernel.commanded, bench.now
        account.accepted_at = bench.now
    for gap, event in program:
        bench.now += gap
        perform(bench, account, event)
        account.check()
        bench.now += 0.02
        account.check()


@cases(250, thorough=10_000)
@given(programs, ways, peers, roles)
def test_a_stop_and_an_estop_pass_in_every_state(program, way, peer, role):
    bench = bench_with_driver()
    for gap, event in program:
        bench.now += gap
        perform(bench, Account(bench, math.inf), event)
        bench.tick()
    before = bench.kernel.commanded
    assert bench.stop(action_id="the-stop", way=way, peer=peer, role=role, session="s1", epoch=1)
    assert bench.kernel.stop_id == "the-stop"
    assert bench.kernel.navigation is None
    bench.run(0.06)
    after = bench.kernel.commanded
    slower = abs(after.linear) < abs(before.linear) or abs(after.angular) < abs(before.angular)
    assert slower or before == ZERO
    bench.run(2.0)
    assert bench.kernel.commanded == ZERO
    assert bench.estop(action_id="the-estop", way=way, peer=peer, role=role)
    why = {"estop", "fault", "stopped"} if only_watches(bench, way, peer, role) else {"estop"}
    assert bench.kernel.inhibited(bench.now) in why
    bench.run(0.1, every=0.02, linear=0.5)
    assert bench.kernel.commanded == ZERO


@cases(250, thorough=10_000)
@given(programs, speeds, speeds)
def test_navigation_keeps_to_the_limits_and_brakes_under_a_latch_or_fault(program, linear, angular):
    bench = bench_with_driver(wanted=m.Velocity(linear=linear, angular=angular))
    for gap, event in program:
        bench.now += gap
        perform(bench, Account(bench, math.inf), event)
        before = bench.kernel.commanded
        for _ in range(2):
            bench.now += 0.02
            velocity = bench.tick().velocity or ZERO
            assert -LIMITS.reverse <= velocity.linear <= LIMITS.linear
            assert abs(velocity.angular) <= LIMITS.angular
            if bench.kernel.latch or bench.kernel.fault:
                assert abs(velocity.linear) <= abs(before.linear)
                assert abs(velocity.angular) <= abs(before.angular)


@cases(375, thorough=15_000)
@given(
    st.floats(0.001, 0.4),
    st.lists(st.tuples(st.floats(0.001, 0.25), speeds, speeds), min_size=1, max_size=30),
)
def test_robot_is_at_rest_a_deadman_and_a_braking_time_after_the_last_command(first_gap, commands):
    bench = bench_with_driver()
    bench.now += first_gap
    for gap, linear, angular in commands:
        bench.now += gap
        bench.drive(linear, angular)
    last = bench.now
    linear = abs(bench.speed) + LIMITS.linear_acceleration * LIMITS.deadman
    angular = abs(bench.kernel.commanded.angular) + LIMITS.angular_acceleration * LIMITS.deadman
    braking = max(linear / LIMITS.linear_braking, angular / LIMITS.angular_braking)
    while bench.now < last + LIMITS.deadman + braking + 0.03:
        bench.now += 0.02
        bench.tick()
    assert bench.kernel.commanded == ZERO
