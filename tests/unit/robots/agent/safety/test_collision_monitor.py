"""The collision monitor by itself, and as a stage of the kernel's tick."""

import itertools
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from robots.agent.ramp import ZERO
from robots.agent.robot_interface import NOWHERE
from robots.agent.safety.collision_monitor import CollisionMonitor, monitor_of, seen_from
from robots.agent.safety.kernel import KERNEL
from robots.agent.safety.obstacle_sources import LaserSource
from robots.api.geometry import Pose2D
from robots.api.messages import Laser, LeaseLimits, Pose, Scan, Velocity
from tests.support.agents.kernel_bench import LIMITS, TICK, bench_with_driver
from tests.support.agents.scripted_robot import PROFILE, still

AHEAD = Velocity(linear=0.5, angular=0.0)
FOOTPRINT = ((0.3, -0.25), (0.3, 0.25), (-0.3, 0.25), (-0.3, -0.25))
ORIGIN = Pose2D(0.0, 0.0, 0.0)


def reading(stamp=1.0, odometry=ORIGIN, **fields):
    return still(stamp=stamp, odometry=odometry, **fields)


def scan(ranges, stamp=1.0):
    return Scan(
        stamp=stamp, angle_min=-1.0, angle_increment=2.0 / 80, range_max=10.0, ranges=ranges
    )


def wall(distance, stamp=1.0):
    """A scan of a laser in the robot's centre that sees a wall `distance` ahead."""
    return scan(tuple((distance / np.cos(np.linspace(-1.0, 1.0, 81))).tolist()), stamp)


def monitor():
    return CollisionMonitor(FOOTPRINT, LIMITS, [LaserSource(Laser(x=0.0))])


@pytest.fixture
def watch():
    return monitor()


# --- by itself ------------------------------------------------------------------------------------


def test_a_monitor_without_a_scan_stops_the_driver_and_reports_that_for_a_moment(watch):
    assert watch.shape(AHEAD, ZERO, "slow", 1.0).velocity == ZERO
    assert watch.why(1.1)[0] == "blind"
    assert watch.why(2.0) == ("", None)
    assert watch.clearance() is None
    assert watch.points().shape == (0, 2)


def test_a_covered_or_silent_laser_counts_as_blind(watch):
    watch.sense(reading(scan=wall(3.0)), 1.0)
    watch.sense(reading(1.4, scan=scan((None,) * 81, 1.4)), 1.4)
    assert watch.shape(AHEAD, AHEAD, "slow", 1.45).why == "free"
    assert watch.shape(AHEAD, AHEAD, "slow", 1.55).why == "blind"


@pytest.mark.parametrize("more", [(), ("localization", "goto"), ("assist",)])
def test_a_robot_with_a_sensor_has_a_monitor_with_any_capability(more):
    assert monitor_of(PROFILE) is None
    able = (*PROFILE.capabilities, *more)
    assert monitor_of(replace(PROFILE, laser=Laser(x=0.0), capabilities=able)) is not None


def test_the_dock_is_located_relative_to_a_localized_robot_only():
    dock = SimpleNamespace(x=3.0, y=1.0, theta=math.pi / 2)
    found = seen_from(Pose(x=1.0, y=1.0, theta=0.0), dock)
    assert found == pytest.approx((2.0, 0.0, math.pi / 2))
    assert seen_from(NOWHERE, dock) is None
    assert seen_from(Pose(x=1.0, y=1.0, theta=0.0), None) is None


# --- as a stage of the tick -----------------------------------------------------------------------


class Scripted:
    """A shaper that returns what the test says, and records its calls."""

    def __init__(self, turn=0.0, share=1.0):
        self.turn, self.share, self.asked = turn, share, []

    def shape(self, wanted, told, level, now):
        self.asked.append((wanted, told, level))
        self.own = Velocity(linear=wanted.linear * self.share, angular=wanted.angular)
        turn = self.turn if level == "steer" else 0.0
        self.velocity = Velocity(linear=self.own.linear, angular=self.own.angular + turn)
        return self


def bench(shaper, level="steer"):
    made = bench_with_driver(monitor=shaper)
    made.kernel.assist.level = level
    return made


def test_an_added_turn_is_sent_and_does_not_count_as_the_drivers():
    made = bench(Scripted(turn=0.01))
    made.run(1.0, every=0.06, linear=0.3)
    assert made.kernel.commanded.angular == pytest.approx(0.01)
    assert max(abs(wanted.angular) for wanted, _, _ in made.kernel.monitor.asked) == 0.0


def test_an_added_turn_is_cut_to_the_leases_limit_and_then_checked_again():
    made = bench(Scripted(turn=0.3))
    made.lease(renewal=1, limits=LeaseLimits(angular=0.1))
    made.run(2.0, every=0.06, linear=0.3)
    turns = [abs(decision.velocity.angular) for _, decision in made.outputs if decision.velocity]
    assert max(turns) == pytest.approx(0.1)
    assert made.kernel.monitor.asked[-1][2] == "slow"


def test_ramp_leads_a_base_that_takes_less_by_a_third_of_a_second_at_most():
    made = bench(Scripted(), level="slow")
    made.run(1.0, every=0.06, linear=0.4)
    made.kernel.applied(Velocity(linear=0.1, angular=0.0))
    assert made.kernel.commanded.linear == 0.1
    made.now += TICK
    made.drive(0.4)
    ahead = 0.1 + LIMITS.linear_acceleration * (KERNEL.longest_wait + TICK)
    wanted, sent, level = made.kernel.monitor.asked[-1]
    assert wanted == Velocity(linear=pytest.approx(ahead), angular=0.0)
    assert (sent, level) == (Velocity(linear=0.1, angular=0.0), "slow")


def test_released_robot_brakes_on_the_checked_course_without_an_added_turn():
    made = bench(Scripted(turn=0.2))
    made.run(1.5, every=0.06, linear=0.4)
    asked = len(made.kernel.monitor.asked)
    made.drive(0.0)
    made.run(1.0)
    assert len(made.kernel.monitor.asked) == asked
    assert made.kernel.commanded == ZERO


def test_velocity_of_the_agents_own_navigation_is_not_shaped():
    made = bench(Scripted(share=0.0))
    made.run(1.0)
    made.navigate(by_server=True)
    made.wanted = Velocity(linear=0.4, angular=0.0)
    made.run(2.0)
    assert made.kernel.commanded.linear == pytest.approx(0.4)


def test_a_robot_that_becomes_blind_brakes_at_the_rate_of_its_base(watch):
    made = bench(watch, "slow")
    for _ in range(100):
        watch.sense(reading(made.now, scan=wall(9.0, made.now)), made.now)
        made.run(TICK, every=TICK, linear=0.5)
    assert made.speed > 0.45
    before = len(made.outputs)
    made.run(1.5, every=TICK, linear=0.5)
    sent = [decision.velocity for _, decision in made.outputs[before:] if decision.velocity]
    assert made.speed == 0.0
    steps = [after.linear - before.linear for before, after in itertools.pairwise(sent)]
    assert min(steps) >= -LIMITS.linear_braking * TICK - 1e-9
