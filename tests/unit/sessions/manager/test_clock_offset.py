"""The robot's clock, from the beats that it echoes."""

import random

import pytest

from robots.api.messages import Echo, Heartbeat
from sessions.manager.clock_offset import ClockOffset


def beat(
    n: int, sent: float, there: float, back: float, offset: float, *, held: float = 0.05
) -> tuple[Heartbeat, float]:
    """A beat whose echo took `there` seconds to the robot, was held there, and took `back` seconds
    to us.
    """
    received = sent + there + offset
    echo = Echo(peer="server", n=n, stamp=sent, received=received)
    return Heartbeat(n=n, stamp=received + held, echoes=(echo,)), sent + there + held + back


def test_before_the_first_echo_nothing_is_known():
    clock = ClockOffset("server")
    clock.on_heartbeat(Heartbeat(n=1, stamp=5.0), 5.0)
    clock.on_heartbeat(
        Heartbeat(n=1, stamp=5.0, echoes=(Echo(peer="page", n=1, stamp=1.0, received=1.0),)), 5.0
    )
    assert clock.seconds is None


@pytest.mark.parametrize("offset", [-3600.0, 0.0, 0.2, 1e6])
def test_an_even_delay_leaves_no_error(offset):
    clock = ClockOffset("server")
    clock.on_heartbeat(*beat(1, 1000.0, 0.04, 0.04, offset))
    assert clock.seconds == pytest.approx(offset, abs=1e-6)
    assert clock.round_trip == pytest.approx(0.08, abs=1e-6)


def test_the_exchange_with_the_least_round_trip_counts():
    rng, clock = random.Random(4), ClockOffset("server")
    for n in range(10):
        there, back = (0.002, 0.002) if n == 6 else (0.002 + rng.expovariate(5.0), 0.002)
        clock.on_heartbeat(*beat(n, 1000.0 + n, there, back, 7.0))
    assert clock.seconds == pytest.approx(7.0, abs=1e-6)


def test_the_error_is_at_most_half_of_the_asymmetry_of_a_delay():
    rng, clock = random.Random(5), ClockOffset("server")
    for n in range(50):
        clock.on_heartbeat(*beat(n, 1000.0 + n, rng.uniform(0.0, 0.2), rng.uniform(0.0, 0.2), -2.0))
        assert abs(clock.seconds + 2.0) <= clock.round_trip / 2 + 1e-6


def test_a_repeated_echo_is_no_measurement_and_old_ones_are_forgotten():
    clock = ClockOffset("server")
    first, received = beat(1, 1000.0, 0.001, 0.001, 0.0)
    clock.on_heartbeat(first, received)
    for n in range(2, 12):
        clock.on_heartbeat(*beat(n, 1000.0 + n, 0.01, 0.01, 5.0))
        clock.on_heartbeat(first, received + n) if n == 11 else None
    assert clock.seconds == pytest.approx(5.0, abs=1e-6)


def test_a_restarted_server_that_counts_from_one_is_accepted():
    clock = ClockOffset("server")
    clock.on_heartbeat(*beat(500, 1000.0, 0.01, 0.01, 1.0))
    clock.on_heartbeat(*beat(1, 2000.0, 0.001, 0.001, 2.0))
    assert clock.seconds == pytest.approx(2.0, abs=1e-6)
