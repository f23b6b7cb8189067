"""Which states have been seen, and which are owed."""

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


def test_a_state_that_comes_twice_is_new_once(tracker):
    assert not tracker.arrive(7, "s", 1.0)
    assert due(tracker, 100.0) == ([], [])


def test_a_hole_is_asked_for_after_a_moment_and_again_until_it_is_filled(tracker):
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


def asked_in_vain(tracker, hole, *, first_at):
    """Request a gap that is never filled until it is given up; return the losses."""
    now = first_at
    while now < ASKING_SECONDS:
        assert due(tracker, now) == ([hole], [])
        now += REPEAT
    asks, losses = due(tracker, now)
    assert asks == []
    return losses


def test_a_hole_that_is_never_filled_is_a_loss_of_the_sessions_that_it_touches(tracker):
    tracker.arrive(13, "t", 0.0)
    losses = asked_in_vain(tracker, (11, 12), first_at=FIRST_REQUEST_S)
    assert [(loss.ranges, loss.sessions, loss.count) for loss in losses] == [
        (((11, 12),), frozenset("st"), 2)
    ]
    assert not tracker.owes("s")


def test_requests_wait_while_the_robot_is_away_and_none_is_given_up(tracker):
    tracker.arrive(12, "s", 0.0)
    assert due(tracker, 1000.0, present=False) == ([], [])
    for attempt in range(ATTEMPTS):
        assert due(tracker, 1001.0 + attempt * REPEAT) == ([(11, 11)], [])
    _, losses = due(tracker, 1001.0 + ATTEMPTS * REPEAT)
    assert [loss.count for loss in losses] == [1]


def test_states_of_an_earlier_run_of_the_agent_are_lost_at_once(tracker):
    tracker.arrive(12, "s", 0.0)
    _, losses = due(tracker, 0.1, alive=False)
    assert [loss.count for loss in losses] == [1]


def test_states_without_a_session_are_nobodys_loss(tracker):
    tracker.arrive(11, None, 0.0)
    tracker.arrive(20, None, 0.0)
    assert due(tracker, 100.0) == ([], [])


def test_a_pause_of_the_lease_is_no_hole(tracker):
    for seq in range(11, 15):
        tracker.arrive(seq, None, 0.0)
    tracker.arrive(15, "s", 0.0)
    assert due(tracker, 100.0) == ([], [])


def test_the_first_states_of_a_session_are_owed_from_its_beginning():
    tracker = SequenceTracker()
    tracker.begins(100, "s", 0.0)
    tracker.arrive(103, "s", 0.0)
    assert due(tracker, 2.0) == ([(100, 102)], [])


def test_the_last_states_of_a_session_are_owed_up_to_its_end(tracker):
    tracker.ends(13, "s", 0.0)
    assert tracker.owes("s")
    assert due(tracker, 2.0) == ([(11, 13)], [])


def test_a_session_that_ends_where_it_was_seen_owes_nothing(tracker):
    tracker.ends(10, "s", 0.0)
    assert not tracker.owes("s")


def test_after_a_restart_the_stored_states_count_and_what_came_since_is_owed():
    tracker = SequenceTracker()
    tracker.restore("s", StoredStates(((1, 10), (11, 20)), begins=1), 0.0)
    assert not tracker.arrive(15, "s", 0.0)
    assert tracker.arrive(31, "s", 0.0)
    assert due(tracker, 2.0) == ([(21, 30)], [])


def test_a_hole_that_was_stored_is_asked_for_again_and_not_missed():
    tracker = SequenceTracker()
    tracker.restore("s", StoredStates(((1, 10), (15, 20)), begins=1), 0.0)
    assert asked_in_vain(tracker, (11, 14), first_at=2.0) == []
    assert not tracker.owes("s")


def test_a_hole_that_was_stored_is_filled_by_the_second_answer_where_the_first_was_lost():
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


def test_without_a_known_first_state_the_minute_before_is_requested():
    tracker = SequenceTracker()
    tracker.restore("s", StoredStates(((1000, 1010),)), 0.0)
    assert due(tracker, 2.0) == ([(1000 - HEAD, 999)], [])


def test_events_tell_of_states_none_of_which_is_stored():
    tracker = SequenceTracker()
    tracker.arrive(500, None, 0.0)
    tracker.restore("s", StoredStates(begins=300, ends=350), 0.0)
    assert due(tracker, 2.0) == ([(300, 499)], [])


def test_of_a_session_of_which_nothing_is_known_the_minute_before_all_is_asked_for():
    tracker = SequenceTracker()
    tracker.arrive(500, None, 0.0)
    tracker.suspect_before("s", 0.0)
    assert due(tracker, 2.0) == ([(500 - HEAD, 499)], [])
    assert tracker.owes("s")


def test_a_restart_in_the_middle_of_a_calm_session_asks_for_nothing():
    tracker = SequenceTracker()
    tracker.restore("s", StoredStates(((11, 20),), begins=11), 0.0)
    tracker.arrive(21, "s", 0.0)
    assert due(tracker, 2.0) == ([], [])


def test_without_any_knowledge_the_last_minute_is_asked_for_and_not_missed():
    tracker = SequenceTracker()
    tracker.arrive(1000, "s", 0.0)
    assert asked_in_vain(tracker, (1000 - HEAD, 999), first_at=2.0) == []


def test_a_robot_that_counts_strangely_costs_nothing(tracker):
    tracker.arrive(2**53 - 1, "s", 0.0)
    tracker.arrive(11, "s", 0.0)
    assert due(tracker, 100.0) == ([], [])


@examples(100, thorough=3000)
@given(st.permutations(range(1, 31)), st.sets(st.integers(2, 29), max_size=10))
def test_in_whatever_order_states_come_what_is_owed_is_what_is_missing(order, lost):
    tracker = SequenceTracker()
    tracker.begins(1, "s", 0.0)
    for seq in order:
        if seq not in lost:
            tracker.arrive(seq, "s", 0.0)
    tracker.ends(30, "s", 0.0)
    asked = {seq for low, high in due(tracker, 2.0)[0] for seq in range(low, high + 1)}
    assert asked == lost
