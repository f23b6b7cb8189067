"""The emulated network: order, rate, chance, and reproducible fates."""

import functools
import itertools
import math

import pytest
from hypothesis import given, strategies as st

from robots.agent.lab.line import HOLD, MOST_WAITING, QUEUE, NetworkLine
from robots.api.messages import NetworkLab
from tests.support.examples import examples

LABS = st.builds(
    NetworkLab,
    delay=st.floats(0.0, 0.5),
    jitter=st.floats(0.0, 0.2),
    loss=st.sampled_from([0.0, 0.1, 0.5, 1.0]),
    reorder=st.sampled_from([0.0, 0.1, 1.0]),
    bitrate=st.none() | st.floats(2e4, 2e6),
    seed=st.integers(0, 1000),
)
# Gaps before packets in seconds, and their sizes in bytes.
ARRIVALS = st.lists(st.tuples(st.floats(0.0, 0.1), st.integers(1, 1200)), max_size=60)


def run(lab, arrivals):
    """Offer packets, take those that are due; return the line and (moment, number) of what came."""
    line, came, now = NetworkLine(lab), [], 0.0

    def deliver_until(end):
        nonlocal now
        while (at := line.next()) is not None and at <= end:
            now = max(now, at)
            for deliver in line.due(now):
                deliver()
        now = end

    for number, (gap, size) in enumerate(arrivals):
        deliver_until(now + gap)
        line.offer(functools.partial(lambda number: came.append((now, number)), number), size, now)
    deliver_until(now + 100.0)
    return line, came


@given(LABS, ARRIVALS)
def test_every_packet_leaves_once_or_is_counted_as_lost_or_overflowed(lab, arrivals):
    line, came = run(lab, arrivals)
    counts = line.counts
    assert len({number for _, number in came}) == len(came) == counts.out
    assert counts.taken == len(arrivals) == counts.out + counts.lost + counts.overflowed
    assert line.waiting == 0
    assert line.next() is None


@given(LABS, ARRIVALS)
def test_the_same_seed_and_arrivals_have_the_same_result(lab, arrivals):
    assert run(lab, arrivals)[1] == run(lab, arrivals)[1]


@given(LABS, ARRIVALS)
def test_packets_keep_their_order_despite_jitter(lab, arrivals):
    clean = NetworkLab(
        delay=lab.delay, jitter=lab.jitter, loss=lab.loss, bitrate=lab.bitrate, seed=lab.seed
    )
    numbers = [number for _, number in run(clean, arrivals)[1]]
    assert numbers == sorted(numbers)


@given(LABS, ARRIVALS)
def test_packets_leave_within_the_bounds_of_delay_and_jitter(lab, arrivals):
    line, came = run(lab, arrivals)
    times, at = [], 0.0
    for gap, _ in arrivals:
        at += gap
        times.append(at)
    largest = max((size for _, size in arrivals), default=0)
    transmission = QUEUE + largest * 8.0 / lab.bitrate if lab.bitrate else 0.0
    for moment, number in came:
        held = moment - times[number]
        assert held >= max(0.0, lab.delay - lab.jitter) - 1e-9
        assert held <= lab.delay + lab.jitter + transmission + HOLD + 1e-9
    assert line.counts.held == pytest.approx(
        sum(moment - times[number] for moment, number in came), abs=1e-6
    )


@given(st.floats(2e4, 1e6), ARRIVALS, st.floats(0.0, 0.3))
def test_no_window_of_time_exceeds_the_bit_rate_by_more_than_one_packet(bitrate, arrivals, delay):
    _, came = run(NetworkLab(bitrate=bitrate, delay=delay), arrivals)
    sizes = [size for _, size in arrivals]
    for first in range(len(came)):
        for last in range(first, len(came)):
            window = came[last][0] - came[first][0]
            sent = sum(sizes[number] for _, number in came[first + 1 : last + 1])
            assert sent * 8.0 <= bitrate * window + 1e-3


def test_packet_beyond_the_queue_is_dropped():
    line, came = run(NetworkLab(bitrate=8000.0), [(0.0, 100)] * 20)  # 0.1 s a packet
    assert len(came) == 6, "the one that is sent, and five that wait for up to half a second"
    assert line.counts.overflowed == 14
    assert [moment for moment, _ in came] == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])


@pytest.mark.parametrize("loss", [0.02, 0.2, 0.5])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_share_of_lost_packets_is_within_its_binomial_bounds(loss, seed):
    line = NetworkLine(NetworkLab(loss=loss, seed=seed))
    number = 5000
    for _ in range(number):
        line.offer(lambda: None, 100, 0.0)
        line.due(0.0)
    assert abs(line.counts.lost / number - loss) < 4.0 * math.sqrt(loss * (1.0 - loss) / number)


def test_loss_of_a_packet_does_not_depend_on_delay_order_or_rate():
    def lost(**lab):
        return set(range(200)) - {
            number for _, number in run(NetworkLab(loss=0.3, seed=5, **lab), [(0.01, 100)] * 200)[1]
        }

    assert lost() == lost(delay=0.2, jitter=0.1) == lost(reorder=0.5) == lost(bitrate=1e6)


def test_jitter_spreads_evenly_around_the_delay():
    _, came = run(NetworkLab(delay=0.3, jitter=0.1, seed=4), [(0.5, 100)] * 400)
    held = [moment - 0.5 * (number + 1) for moment, number in came]
    assert 0.2 <= min(held) < 0.21
    assert 0.39 < max(held) <= 0.4 + 1e-9
    assert sum(held) / len(held) == pytest.approx(0.3, abs=0.01)


def test_a_reordered_packet_leaves_right_after_the_next_one():
    line, came = run(NetworkLab(delay=0.05, reorder=0.3, seed=1), [(0.01, 100)] * 30)
    numbers = [number for _, number in came]
    moved = sum(number > after for number, after in itertools.pairwise(numbers))
    assert numbers != sorted(numbers)
    assert moved <= line.counts.reordered
    assert line.counts.reordered > 0


def test_a_reordered_packet_without_a_successor_leaves_after_a_while():
    line, came = run(NetworkLab(delay=0.05, reorder=1.0), [(0.0, 100)])
    assert came == [(pytest.approx(0.05 + HOLD), 0)]
    assert line.counts.reordered == 0


@pytest.mark.slow
@examples(20, thorough=1000)
@given(st.integers(1, 50))
def test_a_flood_is_bounded(more):
    line = NetworkLine(NetworkLab(delay=10.0))
    for _ in range(MOST_WAITING + more):
        line.offer(lambda: None, 1, 0.0)
    assert line.waiting == MOST_WAITING
    assert line.counts.overflowed == more
