"""Limits on attempts in a sliding window."""

import itertools

import pytest
from hypothesis import given, strategies as st

from accounts.attempts import Attempts

NUMBERS = itertools.count()
MINUTE = 60.0
FULL = 1_000_000_020.0  # a full minute of Unix time


def attempts(limit):
    return Attempts(f"unit-{next(NUMBERS)}", limit)


def test_a_limit_does_not_apply_twice_around_a_full_minute():
    some = attempts(5)
    assert all(some.count("ada", FULL - 1.0) for _ in range(5))
    assert not some.count("ada", FULL + 1.0)


@given(
    gaps=st.lists(st.floats(0.0, 30.0), min_size=1, max_size=60),
    start=st.floats(1e9, 1e9 + 120.0),
    limit=st.integers(1, 6),
)
def test_no_minute_has_more_attempts_than_the_limit(gaps, start, limit):
    some, passed, now = attempts(limit), [], start
    for gap in gaps:
        now += gap
        if some.count("ada", now):
            passed.append(now)
    for first in passed:
        assert sum(first <= at < first + MINUTE for at in passed) <= limit


@given(
    gaps=st.lists(st.floats(0.0, 30.0), min_size=1, max_size=30), start=st.floats(1e9, 1e9 + 120.0)
)
def test_an_attempt_after_the_announced_wait_is_allowed(gaps, start):
    some, now = attempts(3), start
    for gap in gaps:
        now += gap
        if not some.count("ada", now):
            wait = some.wait("ada", now)
            assert 1 <= wait <= 67
            now += wait
            assert some.count("ada", now)


def test_further_attempts_do_not_prolong_the_wait():
    some = attempts(2)
    passed = [second for second in range(200) if some.count("ada", FULL + second)]
    assert passed[:2] == [0, 1]
    assert 60 <= passed[2] <= 66


def test_a_remaining_attempt_is_reported():
    some = attempts(1)
    assert some.are_left("ada", FULL)
    assert some.count("ada", FULL)
    assert not some.are_left("ada", FULL + 59.0)
    assert some.are_left("ada", FULL + 67.0)
    assert some.are_left("ben", FULL)


@pytest.mark.parametrize("seconds", [10**9, 1, 300])
def test_windows_of_every_length_keep_their_limit(seconds):
    some = Attempts(f"unit-{next(NUMBERS)}", 2, seconds)
    assert [some.count("ada", FULL + seconds * part / 10) for part in range(3)] == [
        True,
        True,
        False,
    ]
