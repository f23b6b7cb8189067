"""Clock offsets from heartbeats."""

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robots.agent.safety.clock_sync import PeerClock, PeerClocks
from robots.api import messages as m


def exchange(clock, *, at, there, back, offset, pause=0.05):
    return clock.add(
        sent=at,
        peer_received=at + there + offset,
        peer_sent=at + there + pause + offset,
        received=at + there + pause + back,
    )


@given(
    st.floats(-1e6, 1e6),
    st.lists(st.tuples(st.floats(0, 0.5), st.floats(0, 0.5)), min_size=3, max_size=30),
)
def test_the_offset_is_wrong_by_at_most_half_of_the_least_round_trip_of_the_last_ten(offset, ways):
    clock = PeerClock()
    for step, (there, back) in enumerate(ways):
        exchange(clock, at=float(step), there=there, back=back, offset=offset)
    best = min(there + back for there, back in ways[-10:])
    assert clock.round_trip == pytest.approx(best, abs=1e-6)
    assert abs(clock.age(offset + 100.0, 100.0)) <= best / 2 + 1e-6


def test_a_clock_is_known_after_three_echoes():
    clock = PeerClock()
    for step in range(3):
        assert not clock.known
        exchange(clock, at=float(step), there=0.01, back=0.01, offset=5.0)
    assert clock.known


def test_stamps_that_contradict_each_other_are_no_sample():
    clock = PeerClock()
    assert not clock.add(sent=10.0, peer_received=5.0, peer_sent=4.0, received=11.0)
    assert not clock.add(sent=10.0, peer_received=5.0, peer_sent=9.0, received=11.0)
    assert not clock.add(sent=10.0, peer_received=5.0, peer_sent=5.0, received=99.0)
    assert not clock.samples


def test_an_old_bad_sample_is_forgotten_when_the_peers_clock_has_jumped():
    clock, noise = PeerClock(), random.Random(4)
    for step in range(30):
        exchange(
            clock,
            at=float(step),
            there=noise.uniform(0.01, 0.2),
            back=noise.uniform(0.01, 0.2),
            offset=0.0 if step < 15 else 60.0,
        )
    assert clock.age(60.0 + 50.0, 50.0) == pytest.approx(0.0, abs=0.1)


def test_only_an_echo_of_a_beat_that_we_sent_counts_and_by_our_own_record():
    clocks = PeerClocks()
    beat = clocks.beat(10.0, 1000.0)
    forged = m.Echo(peer="robot", n=99, stamp=0.0, received=500.0)
    lying = m.Echo(peer="robot", n=beat.n, stamp=123.0, received=500.0)
    for _ in range(3):
        clocks.heard(
            "p1", "mqtt", m.CommandHeartbeat(n=1, stamp=500.1, echo=forged), now=10.2, unix=1000.2
        )
    assert clocks.of("p1") is None
    for _ in range(3):
        clocks.heard(
            "p1", "mqtt", m.CommandHeartbeat(n=1, stamp=500.1, echo=lying), now=10.2, unix=1000.2
        )
    assert clocks.of("p1").round_trip == pytest.approx(0.1)


def test_the_last_beat_of_at_most_eight_peers_heard_lately_is_echoed():
    clocks = PeerClocks()
    for number in range(40):
        clocks.heard(
            f"p{number}",
            "mqtt",
            m.CommandHeartbeat(n=number, stamp=5.0),
            now=100.0 + number,
            unix=7.0,
        )
    echoes = clocks.beat(139.0, 50.0).echoes
    assert [echo.peer for echo in echoes] == [f"p{n}" for n in range(39, 33, -1)]
    assert echoes[0] == m.Echo(peer="p39", n=39, stamp=5.0, received=7.0)
    for number in range(20):
        clocks.heard(f"q{number}", "mqtt", m.CommandHeartbeat(n=1, stamp=5.0), now=140.0, unix=7.0)
    assert len(clocks.beat(140.0, 51.0).echoes) == 8


def test_each_way_has_an_echo_of_its_own_so_that_a_page_knows_which_of_them_lives():
    clocks = PeerClocks()
    clocks.heard("p1", "datachannel", m.CommandHeartbeat(n=2, stamp=5.0), now=100.0, unix=7.0)
    clocks.heard("p1", "mqtt", m.CommandHeartbeat(n=3, stamp=5.1), now=100.1, unix=7.1)
    assert {echo.n for echo in clocks.beat(100.2, 7.2).echoes} == {2, 3}


def test_a_peer_that_never_echoes_is_known_roughly_by_its_fastest_beat():
    clocks = PeerClocks()
    assert clocks.rough_age("server", 5.0, 10.0) is None
    for at, delay in ((10.0, 0.4), (10.2, 0.02), (10.4, 0.9)):
        clocks.heard(
            "server", "mqtt", m.CommandHeartbeat(n=1, stamp=5000.0 + at - delay), now=at, unix=0.0
        )
    assert clocks.of("server") is None
    assert clocks.rough_age("server", 5009.0, 11.0) == pytest.approx(1.98)
