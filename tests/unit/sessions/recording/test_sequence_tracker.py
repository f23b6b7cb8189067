"""Received, missing and requested states."""

import itertools

import hypothesis.strategies as st
import pytest
from hypothesis import given

from sessions.recording.sequence_tracker import (
    ASKING_SECONDS,
    ATTEMPTS,
    FIRST_REQUEST_S,
    HEAD,
    REPEAT,
    Intervals,
    SequenceTracker,
    StoredStates,
)
from tests.support.examples import examples

NUMBERS = st.integers(0, 60)
RANGES = st.lists(
    st.tuples(NUMBERS, st.integers(0, 8)).map(lambda pair: (pair[0], pair[0] + pair[1])),
    max_size=20,
)


@examples(100, thorough=4000)
@given(ranges=RANGES, first=NUMBERS, width=st.integers(0, 40))
def test_intervals_are_a_set_of_numbers(ranges, first, width):
    intervals, plain = Intervals(), set()
    for low, high in ranges:
        intervals.add(low, high)
        plain |= set(range(low, high + 1))
    assert {number for number in range(80) if number in intervals} == plain
    missing = [
        number
        for low, high in intervals.missing(first, first + width)
        for number in range(low, high + 1)
    ]
    assert missing == [number for number in range(first, first + width + 1) if number not in plain]
    kept = list(intervals)
    assert all(after[0] > before[1] + 1 for before, after in itertools.pairwise(kept)), (
        "ranges neither touch nor overlap"
    )


def due(tracker: SequenceTracker, now: float, *, present: bool = True, alive: bool = True):
    return tracker.due(now, present=present, alive=alive)


@pytest.fixture
def tracker() -> SequenceTracker:
    """A tracker in the middle of the session `s`, whose last state was 10."""
    tracker = SequenceTracker()
    tracker.begins(1, "s", 0.0)
    for seq in range(1, 11):
        assert tracker.arrive(seq, "s", 0.0)
    return tracker


def test_a_repeated_state_is_not_new(tracker):
    assert not tracker.arrive(7, "s", 1.0)
    assert due(tracker, 100.0) == ([], [])


def test_a_gap_is_requested_after_a_second_and_repeatedly_until_it_is_filled(tracker):
    tracker.arrive(14, "s", 0.0)
    assert due(tracker, FIRST_REQUEST_S / 2) == ([], [])
    assert due(tracker, FIRST_REQUEST_S) == ([(11, 13)], [])
    assert due(tracker, FIRST_REQUEST_S + REPEAT / 2) == ([], [])
    tracker.arrive(12, "s", 2.0)
    assert due(tracker, FIRST_REQUEST_S + REPEAT) == ([(11, 11), (13, 13)], [])
    tracker.arrive(11, "s", 7.0)
    tracker.arrive(13, "s", 7.0)
    assert due(tracker, 100.0) == ([], [])
    assert not tracker.owes("s")


def losses_without_an_answer(tracker, gap, *, first_at):
    """Request a gap that is never filled until it is given up; return the losses."""
    now = first_at
    while now < ASKING_SECONDS:
        assert due(tracker, now) == ([gap], [])
        now += REPEAT
    requests, losses = due(tracker, now)
    assert requests == []
    return losses


def test_a_gap_that_is_never_filled_is_a_loss_of_the_sessions_that_it_touches(tracker):
    tracker.arrive(13, "t", 0.0)
    losses = losses_without_an_answer(tracker, (11, 12), first_at=FIRST_REQUEST_S)
    assert [(loss.ranges, loss.sessions, loss.count) for loss in losses] == [
        (((11, 12),), frozenset("st"), 2)
    ]
    assert not tracker.owes("s")


def test_requests_wait_for_an_absent_robot(tracker):
    tracker.arrive(12, "s", 0.0)
    assert due(tracker, 1000.0, present=False) == ([], [])
    for attempt in range(ATTEMPTS):
        assert due(tracker, 1001.0 + attempt * REPEAT) == ([(11, 11)], [])
    _, losses = due(tracker, 1001.0 + ATTEMPTS * REPEAT)
    assert [loss.count for loss in losses] == [1]


def test_missing_states_of_an_earlier_run_of_the_agent_are_lost_at_once(tracker):
    tracker.arrive(12, "s", 0.0)
    _, losses = due(tracker, 0.1, alive=False)
    assert [loss.count for loss in losses] == [1]


def test_missing_states_outside_sessions_are_no_loss(tracker):
    tracker.arrive(11, None, 0.0)
    tracker.arrive(20, None, 0.0)
    assert due(tracker, 100.0) == ([], [])


def test_states_without_a_lease_leave_no_gap(tracker):
    for seq in range(11, 15):
        tracker.arrive(seq, None, 0.0)
    tracker.arrive(15, "s", 0.0)
    assert due(tracker, 100.0) == ([], [])


def test_the_missing_first_states_of_a_session_are_requested():
    tracker = SequenceTracker()
    tracker.begins(100, "s", 0.0)
    tracker.arrive(103, "s", 0.0)
    assert due(tracker, 2.0) == ([(100, 102)], [])


def test_the_missing_last_states_of_a_session_are_requested(tracker):
    tracker.ends(13, "s", 0.0)
    assert tracker.owes("s")
    assert due(tracker, 2.0) == ([(11, 13)], [])


def test_a_session_with_a_received_last_state_misses_nothing(tracker):
    tracker.ends(10, "s", 0.0)
    assert not tracker.owes("s")


def test_after_a_restart_the_states_that_are_not_stored_are_requested():
    tracker = SequenceTracker()
    tracker.restore("s", StoredStates(((1, 10), (11, 20)), begins=1), 0.0)
    assert not tracker.arrive(15, "s", 0.0)
    assert tracker.arrive(31, "s", 0.0)
    assert due(tracker, 2.0) == ([(21, 30)], [])


def test_a_stored_gap_is_requested_again_and_is_no_new_loss():
    tracker = SequenceTracker()
    tracker.restore("s", StoredStates(((1, 10), (15, 20)), begins=1), 0.0)
    assert losses_without_an_answer(tracker, (11, 14), first_at=2.0) == []
    assert not tracker.owes("s")


def test_a_stored_gap_is_filled_by_the_second_answer_if_the_first_is_lost():
    tracker = SequenceTracker()
    tracker.restore("s", StoredStates(((1, 10), (12, 20)), begins=1), 0.0)
    assert due(tracker, 2.0) == ([(11, 11)], [])
    assert due(tracker, 2.0 + REPEAT) == ([(11, 11)], [])
    assert tracker.arrive(11, "s", 3.0 + REPEAT)
    assert due(tracker, 2.0 + 2 * REPEAT) == ([], [])


def test_states_received_and_not_stored_are_requested_after_their_session():
    """The next session manager receives only states without a session: the last ones of the
    session were in the memory of the previous one; its first number is known from an event.
    """
    tracker = SequenceTracker()
    tracker.arrive(40, None, 0.0)
    tracker.restore("s", StoredStates(((11, 20),), begins=11), 0.0)
    assert due(tracker, 2.0) == ([(21, 39)], [])
    assert tracker.owes("s")
    for seq in range(21, 40):
        tracker.arrive(seq, "s" if seq < 31 else None, 3.0)
    assert not tracker.owes("s")


def test_states_out_of_order_after_a_takeover_leave_no_gap():
    tracker = SequenceTracker()
    tracker.arrive(30, None, 0.0)
    tracker.restore("s", StoredStates(((11, 20),), begins=11), 0.0)
    for seq in range(25, 30):
        tracker.arrive(seq, "s", 0.0)
    assert due(tracker, 2.0) == ([(21, 24)], [])


@pytest.mark.parametrize(
    ("stored", "arrived", "requested"),
    [
        pytest.param(StoredStates(((11, 20),), begins=11), 21, [], id="nothing is missing"),
        pytest.param(
            StoredStates(begins=300, ends=350), 500, [(300, 499)], id="no state is stored"
        ),
        pytest.param(
            StoredStates(((1000, 1010),)), 1011, [(1000 - HEAD, 999)], id="the first is unknown"
        ),
    ],
)
def test_missing_states_of_a_restored_session_are_requested(stored, arrived, requested):
    tracker = SequenceTracker()
    tracker.arrive(arrived, None, 0.0)
    tracker.restore("s", stored, 0.0)
    assert due(tracker, 2.0) == (requested, [])


def test_for_an_unknown_session_the_minute_before_it_is_requested():
    tracker = SequenceTracker()
    tracker.arrive(500, None, 0.0)
    tracker.suspect_before("s", 0.0)
    assert due(tracker, 2.0) == ([(500 - HEAD, 499)], [])
    assert tracker.owes("s")


def test_without_a_known_session_the_last_minute_is_requested_and_is_no_loss():
    tracker = SequenceTracker()
    tracker.arrive(1000, "s", 0.0)
    assert losses_without_an_answer(tracker, (1000 - HEAD, 999), first_at=2.0) == []


def test_a_jump_of_the_numbers_is_not_requested(tracker):
    tracker.arrive(2**53 - 1, "s", 0.0)
    tracker.arrive(11, "s", 0.0)
    assert due(tracker, 100.0) == ([], [])


@examples(100, thorough=3000)
@given(st.permutations(range(1, 31)), st.sets(st.integers(2, 29), max_size=10))
def test_the_missing_states_are_requested_in_any_order_of_arrival(order, lost):
    tracker = SequenceTracker()
    tracker.begins(1, "s", 0.0)
    for seq in order:
        if seq not in lost:
            tracker.arrive(seq, "s", 0.0)
    tracker.ends(30, "s", 0.0)
    requested = {seq for low, high in due(tracker, 2.0)[0] for seq in range(low, high + 1)}
    assert requested == lost
