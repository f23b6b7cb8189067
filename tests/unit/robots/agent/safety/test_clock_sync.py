"""Clock offsets from heartbeats."""

import heapq
import itertools
import random

import pytest
from hypothesis import given, strategies as st

from robots.agent.safety.clock_sync import PeerClock, PeerClocks
from robots.api import messages as m


def exchange(clock, *, at, there, back, offset, pause=0.05):
    return clock.add(
        sent=at,
        peer_received=at + there + offset,
        peer_sent=at + there + pause + offset,
        received=at + there + pause + back,
    )


@pytest.fixture
def clocks():
    return PeerClocks()


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


def test_inconsistent_stamps_are_no_sample():
    clock = PeerClock()
    assert not clock.add(sent=10.0, peer_received=5.0, peer_sent=4.0, received=11.0)
    assert not clock.add(sent=10.0, peer_received=5.0, peer_sent=9.0, received=11.0)
    assert not clock.add(sent=10.0, peer_received=5.0, peer_sent=5.0, received=99.0)
    assert not clock.samples


def test_an_old_bad_sample_is_forgotten_when_the_peers_clock_has_jumped():
    clock, noise = PeerClock(), random.Random(4)
    for step in range(30):
        there, back = noise.uniform(0.01, 0.2), noise.uniform(0.01, 0.2)
        offset = 0.0 if step < 15 else 60.0
        exchange(clock, at=float(step), there=there, back=back, offset=offset)
    assert clock.age(60.0 + 50.0, 50.0) == pytest.approx(0.0, abs=0.1)


def test_only_echoes_of_sent_heartbeats_count_with_the_recorded_time(clocks):
    beat = clocks.beat(10.0, 1000.0)
    forged = m.Echo(peer="robot", n=99, stamp=0.0, received=500.0)
    lying = m.Echo(peer="robot", n=beat.n, stamp=123.0, received=500.0)
    answers = [m.CommandHeartbeat(n=1, stamp=500.1, echo=echo) for echo in (forged, lying)]
    for _ in range(3):
        clocks.on_heartbeat("p1", "mqtt", answers[0], now=10.2, unix=1000.2)
    assert clocks.of("p1") is None
    for _ in range(3):
        clocks.on_heartbeat("p1", "mqtt", answers[1], now=10.2, unix=1000.2)
    assert clocks.of("p1").round_trip == pytest.approx(0.1)


def hear(clocks, *peers, now, way="mqtt", n=1):
    for peer in peers:
        clocks.on_heartbeat(peer, way, m.CommandHeartbeat(n=n, stamp=5.0), now=now, unix=7.0)


def echoed(clocks, now, first=()):
    return [echo.peer for echo in clocks.beat(now, 50.0, first=first).echoes]


def test_a_heartbeat_has_at_most_sixteen_echoes_of_peers_of_the_last_5_s(clocks):
    for number in range(10):
        hear(clocks, f"p{number}", now=100.0 + number, n=number)
    beat = clocks.beat(109.0, 50.0)
    assert [echo.peer for echo in beat.echoes] == [f"p{n}" for n in range(4, 10)]
    assert beat.echoes[-1] == m.Echo(peer="p9", n=9, stamp=5.0, received=7.0)
    hear(clocks, *(f"q{number}" for number in range(20)), now=110.0)
    assert len(echoed(clocks, 110.0)) == 16


def test_a_peer_with_two_transports_has_both_of_them_echoed_or_neither(clocks):
    for transport in ("mqtt", "datachannel"):
        hear(clocks, *(f"p{number}" for number in range(5)), now=100.0, way=transport)
    hear(clocks, *(f"q{number}" for number in range(7)), now=100.0)
    for transport in ("datachannel", "mqtt"):
        hear(clocks, "driver", now=100.0, way=transport)
    names = echoed(clocks, 100.0, ("driver",))
    assert len(names) <= 16
    assert names[:2] == ["driver", "driver"]
    assert all(names.count(name) == 2 for name in names if name.startswith("p"))


def test_no_number_of_other_peers_evicts_those_of_the_lease(clocks):
    hear(clocks, "driver", "wizard", "server", now=100.0)
    clocks.beat(100.0, 50.0, first=("driver", "wizard"))
    hear(clocks, *(f"p{number}" for number in range(1000)), now=100.1)
    assert set(echoed(clocks, 100.2, ("driver", "wizard"))) > {"driver", "wizard", "server"}
    clocks.beat(100.3, 50.0)  # without a lease
    hear(clocks, *(f"p{number}" for number in range(1000)), now=100.4)
    assert clocks.rough_age("driver", 5.0, 100.4) is None
    assert clocks.rough_age("server", 5.0, 100.4) is not None


class Page:
    """One page with one transport, as static/js/protocol/clock_sync.js: a beat each 0.2 s with an
    echo of the robot's last one; the robot's clock is known by the robot's echoes.
    """

    def __init__(self, name, dice):
        self.name = name
        self.offset, self.drift = dice.uniform(-1e4, 1e4), dice.uniform(-30e-6, 30e-6)
        self.beats = itertools.count()
        self.last = None  # the robot's last beat, and when it arrived by this page's clock
        self.echoed = -1
        self.echoed_at = -1.0

    def clock(self, t):
        return t + self.offset + self.drift * t

    def beat(self, t):
        echo = self.last and m.Echo(
            peer="robot", n=self.last[0].n, stamp=self.last[0].stamp, received=self.last[1]
        )
        return m.CommandHeartbeat(n=next(self.beats), stamp=self.clock(t), echo=echo)

    def hear(self, beat, t):
        self.last = beat, self.clock(t)
        for echo in beat.echoes:
            if echo.peer == self.name and echo.n > self.echoed:
                self.echoed, self.echoed_at = echo.n, t


def drive_among(viewers, seed):
    """A lease is given at 5 s, to a viewer or to a page opened then; yields the time, and the
    driver's page and clock, ten times a second from 3 s after that, for 5 s.
    """
    dice, clocks, numbers = random.Random(seed), PeerClocks(), itertools.count()
    pages = [Page(f"v{number}", dice) for number in range(viewers)]
    driver = dice.choice([dice.choice(pages), Page("newcomer", dice)])
    pages += [driver] if driver.name == "newcomer" else []
    queue = []

    def at(t, what, *arguments):
        heapq.heappush(queue, (t, next(numbers), what, arguments))

    def page_beats(t, page):
        at(t + dice.uniform(0.02, 0.024), hear_page, page, page.beat(t))
        at(t + 0.2 * (1.0 - page.drift), page_beats, page)

    def hear_page(t, page, beat):
        clocks.on_heartbeat(page.name, "mqtt", beat, now=t, unix=t + 1e9)

    def robot_beats(t):
        beat = clocks.beat(t, t + 1e9, first=(driver.name,) if t >= 5.0 else ())
        for page in pages:
            at(t + dice.uniform(0.02, 0.024), lambda t, page=page: page.hear(beat, t))
        at(t + 0.2, robot_beats)

    at(0.0, robot_beats)
    for page in pages:
        at((5.0 if page.name == "newcomer" else 0.0) + dice.uniform(0.0, 0.2), page_beats, page)
    looks = 8.0
    while queue[0][0] < 13.0:
        t, _, what, arguments = heapq.heappop(queue)
        what(t, *arguments)
        if t >= looks:
            looks += 0.1
            yield t, driver, clocks.of(driver.name)


@pytest.mark.parametrize("viewers", [12, 36, pytest.param(150, marks=pytest.mark.slow)])
def test_a_new_driver_has_a_clock_within_3_s_among_any_number_of_viewers(viewers):
    for seed in range(20):
        for t, page, clock in drive_among(viewers, seed):
            assert clock is not None, f"the robot does not know the driver's clock at {t:.1f} s"
            assert abs(clock.age(page.clock(t), t)) < 0.003
            # after 0.5 s without a new echo a page distrusts its transport
            assert t - page.echoed_at < 0.5, f"the driver's page has no echo at {t:.1f} s"


def test_a_peer_that_never_echoes_is_known_roughly_by_its_fastest_beat(clocks):
    assert clocks.rough_age("server", 5.0, 10.0) is None
    for at, delay in ((10.0, 0.4), (10.2, 0.02), (10.4, 0.9)):
        beat = m.CommandHeartbeat(n=1, stamp=5000.0 + at - delay)
        clocks.on_heartbeat("server", "mqtt", beat, now=at, unix=0.0)
    assert clocks.of("server") is None
    assert clocks.rough_age("server", 5009.0, 11.0) == pytest.approx(1.98)
