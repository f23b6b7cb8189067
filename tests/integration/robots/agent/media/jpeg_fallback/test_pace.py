"""When a picture is sent through the server: one at a time, at the driver's pace, in a size that
arrives in time.
"""

import itertools
import random

import pytest

from robots.agent.media.jpeg_fallback.pace import (
    FIRST,
    FPS,
    LAYERS,
    MOST_PAGES,
    PATIENCE,
    PRESENT,
    RETRY,
    StillPace,
    StillQuality,
)


@pytest.fixture
def pace():
    return StillPace(lambda peer: peer == "driver")


def test_no_picture_is_due_before_a_request(pace):
    assert pace.wait(10.0) is None


def test_request_is_answered_at_once_and_only_once(pace):
    pace.ask("driver", None, None, 10.0)
    assert pace.wait(10.0) == 0.0
    pace.sent(1.0, 10.0)
    assert pace.wait(11.0) is None


def test_pictures_keep_their_rate_however_often_a_page_asks(pace):
    now, sent = 0.0, 0
    while now < 10.0:
        pace.ask("driver", None, 0.0, now)
        if pace.wait(now) == 0.0:
            pace.sent(now, now)
            sent += 1
        now += 0.003
    assert sent <= 10 * FPS + 1


def test_observer_waits_while_a_picture_for_the_driver_is_in_transit(pace):
    pace.ask("driver", None, None, 0.0)
    pace.sent(1.0, 0.0)
    pace.ask("observer", None, None, 0.5)
    assert pace.wait(0.5) == pytest.approx(PRESENT - 0.5)
    pace.ask("driver", 1.0, 0.0, 0.7)
    assert pace.wait(0.7) == 0.0


def test_observer_is_served_when_the_driver_is_silent(pace):
    pace.ask("driver", None, None, 0.0)
    pace.sent(1.0, 0.0)
    pace.ask("observer", None, None, 2.5)
    assert pace.wait(PRESENT + 0.1) == 0.0
    assert pace.watching(PRESENT + 0.1) == {"observer"}


def test_slow_observer_reduces_neither_rate_nor_quality_of_the_driver(pace):
    for step in range(1, 60):
        now = step * 0.2
        pace.ask("driver", now - 0.2, 0.0, now - 0.12)
        if step % 10 == 0:
            pace.ask("observer", 0.0, 0.0, now - 0.05)
        assert pace.wait(now) == 0.0
        pace.sent(now, now)
    assert pace.quality.layer <= FIRST


def test_camera_without_a_picture_is_asked_again_after_a_while(pace):
    pace.ask("driver", None, None, 0.0)
    pace.failed(0.0)
    assert pace.wait(0.1) == pytest.approx(RETRY - 0.1)
    assert pace.wait(RETRY) == 0.0


def test_number_of_peers_is_bounded(pace):
    for number in range(10 * MOST_PAGES):
        pace.ask(f"p{number}", None, None, 0.0)
    assert len(pace.watching(0.0)) == MOST_PAGES
    assert pace.watching(PRESENT) == frozenset()


def drive(quality_of_link, seconds, pace, start=0.0, round_trip=0.05):
    """Simulate a driver on a link (bytes/s); return the ages of the pictures in seconds."""
    sizes = (16_000, 10_000, 6_500, 4_500, 3_200, 2_000)
    now, seen, ages = start, None, []
    while now < start + seconds:
        pace.ask("driver", seen, round_trip, now)
        now += pace.wait(now)
        took = round_trip + sizes[pace.quality.layer] / quality_of_link
        seen = now
        pace.sent(seen, now)
        ages.append(took)
        now += took
    return ages


def test_good_network_reaches_the_best_quality(pace):
    drive(2e6, 30.0, pace)
    assert pace.quality.layer == 0


def test_narrow_network_shrinks_pictures_until_they_arrive_in_time(pace):
    ages = drive(15_000.0, 30.0, pace)
    assert sum(age > 0.5 for age in ages[10:]) / len(ages) < 0.1
    assert len(ages) / 30.0 > 2.0


def test_long_round_trip_alone_does_not_reduce_quality(pace):
    drive(2e6, 60.0, pace, round_trip=0.6)
    assert pace.quality.layer == 0


def test_quality_recovers_with_the_network(pace):
    drive(8_000.0, 20.0, pace)
    assert pace.quality.layer == len(LAYERS) - 1
    drive(2e6, 300.0, pace, start=20.0)
    assert pace.quality.layer == 0


def test_request_without_the_last_picture_makes_the_next_one_smaller(pace):
    pace.ask("driver", None, None, 0.0)
    pace.sent(1.0, 0.0)
    pace.ask("driver", None, None, 2.0)
    assert pace.quality.layer == FIRST + 1


def test_failed_steps_up_become_rarer():
    quality, ups = StillQuality(), []
    for number in range(2000):
        before = quality.layer
        quality.took(0.01 if quality.layer >= FIRST else 1.0)
        if quality.layer < before:
            ups.append(number)
    gaps = [second - first for first, second in itertools.pairwise(ups)]
    assert gaps[0] >= PATIENCE
    assert gaps[-1] >= 8 * gaps[0]


def test_any_sequence_of_requests_has_a_layer():
    rng, pace = random.Random(4), StillPace(lambda peer: peer == "p1")
    now = 0.0
    for _ in range(3000):
        now += rng.expovariate(20.0)
        pace.ask(
            rng.choice(["p1", "p2", "p3"]),
            rng.choice([None, now, 0.0]),
            rng.choice([None, 0.0, 0.05, 1e6]),
            now,
        )
        wait = pace.wait(now)
        assert wait is None or wait >= 0.0
        assert pace.layer() in LAYERS
        if wait == 0.0:
            pace.sent(rng.choice([now, 0.0]), now)
