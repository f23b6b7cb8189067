"""Which states have been seen, and which are owed."""

import itertools

import hypothesis.strategies as st
import pytest
from hypothesis import given, settings

from sessions.recording.sequence_tracker import ATTEMPTS, HEAD, PATIENCE, REPEAT, Intervals, SequenceTracker

NUMBERS = st.integers(0, 60)
RANGES = st.lists(st.tuples(NUMBERS, st.integers(0, 8)).map(lambda pair: (pair[0], pair[0] + pair[1])), max_size=20)


@settings(max_examples=400, deadline=None)
@given(ranges=RANGES, first=NUMBERS, width=st.integers(0, 40))
def test_intervals_are_a_set_of_numbers(ranges, first, width):
    intervals, plain = Intervals(), set()
    for low, high in ranges:
        intervals.add(low, high)
        plain |= set(range(low, high + 1))
    assert {number for number in range(80) if number in intervals} == plain
    missing = [number for low, high in intervals.missing(first, first + width) for number in range(low, high + 1)]
    assert missing == [number for number in range(first, first + width + 1) if number not in plain]
    kept = list(intervals)
    assert all(after[0] > before[1] + 1 for before, after in itertools.pairwise(kept)), "ranges neither touch nor overlap"


def due(ledger: SequenceTracker, now: float, *, present: bool = True, alive: bool = True):
    return ledger.due(now, present=present, alive=alive)


@pytest.fixture
def ledger() -> SequenceTracker:
    """A ledger in the middle of the session `s`, whose last state was 10."""
    ledger = SequenceTracker()
    ledger.begins(1, "s", 0.0)
    for seq in range(1, 11):
        assert ledger.arrive(seq, "s", 0.0)
    return ledger


def test_a_state_that_comes_twice_is_new_once(ledger):
    assert not ledger.arrive(7, "s", 1.0)
    assert due(ledger, 100.0) == ([], [])


def test_a_hole_is_asked_for_after_a_moment_and_again_until_it_is_filled(ledger):
    ledger.arrive(14, "s", 0.0)
    assert due(ledger, PATIENCE / 2) == ([], [])
    assert due(ledger, PATIENCE) == ([(11, 13)], [])
    assert due(ledger, PATIENCE + REPEAT / 2) == ([], [])
    ledger.arrive(12, "s", 2.0)
    assert due(ledger, PATIENCE + REPEAT) == ([(11, 11), (13, 13)], [])
    ledger.arrive(11, "s", 7.0)
    ledger.arrive(13, "s", 7.0)
    assert due(ledger, 100.0) == ([], [])
    assert not ledger.owes("s")


def test_a_hole_that_is_never_filled_is_a_loss_of_the_sessions_that_it_touches(ledger):
    ledger.arrive(13, "t", 0.0)
    for attempt in range(ATTEMPTS):
        asks, losses = due(ledger, PATIENCE + attempt * REPEAT)
        assert (asks, losses) == ([(11, 12)], [])
    _, losses = due(ledger, PATIENCE + ATTEMPTS * REPEAT)
    assert [(loss.ranges, loss.sessions, loss.count) for loss in losses] == [(((11, 12),), frozenset("st"), 2)]
    assert not ledger.owes("s")


def test_nobody_is_asked_while_the_robot_is_away_and_nothing_is_given_up(ledger):
    ledger.arrive(12, "s", 0.0)
    assert due(ledger, 1000.0, present=False) == ([], [])
    assert due(ledger, 1001.0) == ([(11, 11)], [])


def test_what_an_earlier_run_of_the_agent_had_is_lost_at_once(ledger):
    ledger.arrive(12, "s", 0.0)
    _, losses = due(ledger, 0.1, alive=False)
    assert [loss.count for loss in losses] == [1]


def test_states_without_a_session_are_nobodys_loss(ledger):
    ledger.arrive(11, None, 0.0)
    ledger.arrive(20, None, 0.0)
    assert due(ledger, 100.0) == ([], [])


def test_a_pause_of_the_lease_is_no_hole(ledger):
    for seq in range(11, 15):
        ledger.arrive(seq, None, 0.0)
    ledger.arrive(15, "s", 0.0)
    assert due(ledger, 100.0) == ([], [])


def test_the_first_states_of_a_session_are_owed_from_its_beginning():
    ledger = SequenceTracker()
    ledger.begins(100, "s", 0.0)
    ledger.arrive(103, "s", 0.0)
    assert due(ledger, 2.0) == ([(100, 102)], [])


def test_the_last_states_of_a_session_are_owed_up_to_its_end(ledger):
    ledger.ends(13, "s", 0.0)
    assert ledger.owes("s")
    assert due(ledger, 2.0) == ([(11, 13)], [])


def test_a_session_that_ends_where_it_was_seen_owes_nothing(ledger):
    ledger.ends(10, "s", 0.0)
    assert not ledger.owes("s")


def test_after_a_restart_the_stored_states_count_and_what_came_since_is_owed():
    ledger = SequenceTracker()
    ledger.restore("s", [(1, 10), (11, 20)], 0.0)
    assert not ledger.arrive(15, "s", 0.0)
    assert ledger.arrive(31, "s", 0.0)
    assert due(ledger, 2.0) == ([(21, 30)], [])


def test_a_hole_that_was_stored_is_asked_for_once_and_not_missed():
    ledger = SequenceTracker()
    ledger.restore("s", [(1, 10), (15, 20)], 0.0)
    assert due(ledger, 2.0) == ([(11, 14)], [])
    assert due(ledger, 2.0 + REPEAT) == ([], [])


def test_without_any_knowledge_the_last_minute_is_asked_for_once():
    ledger = SequenceTracker()
    ledger.arrive(1000, "s", 0.0)
    assert due(ledger, 2.0) == ([(1000 - HEAD, 999)], [])
    assert due(ledger, 2.0 + REPEAT) == ([], [])


def test_a_robot_that_counts_strangely_costs_nothing(ledger):
    ledger.arrive(2**53 - 1, "s", 0.0)
    ledger.arrive(11, "s", 0.0)
    assert due(ledger, 100.0) == ([], [])


@settings(max_examples=300, deadline=None)
@given(st.permutations(range(1, 31)), st.sets(st.integers(2, 29), max_size=10))
def test_in_whatever_order_states_come_what_is_owed_is_what_is_missing(order, lost):
    ledger = SequenceTracker()
    ledger.begins(1, "s", 0.0)
    for seq in order:
        if seq not in lost:
            ledger.arrive(seq, "s", 0.0)
    ledger.ends(30, "s", 0.0)
    asked = {seq for low, high in due(ledger, 2.0)[0] for seq in range(low, high + 1)}
    assert asked == lost
