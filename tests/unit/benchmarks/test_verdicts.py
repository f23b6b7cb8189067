"""What the crash benchmark calls wrong, and what it does not."""

from benchmarks.traffic.bases import motion
from benchmarks.traffic.verdicts import (
    LEAVE_SECONDS,
    DrivePeriod,
    NumberedState,
    longest_pause,
    lost,
    moved_alone,
    shared_epochs,
    two_at_once,
)
from tests.support.agents.scripted_robot import WATCHDOG


def states(*numbers, session="s1", boot="b", epoch=1):
    return [NumberedState("giraff", boot, seq, session, epoch) for seq in numbers]


def test_drives_that_follow_each_other_are_right_and_those_that_overlap_are_not():
    first, second = DrivePeriod("s1", "giraff", 0.0, 10.0), DrivePeriod("s2", "giraff", 10.0, None)
    elsewhere = DrivePeriod("s3", "rhodon", 5.0, None)
    assert two_at_once([first, second, elsewhere]) == []
    assert len(two_at_once([first, DrivePeriod("s2", "giraff", 9.9, None)])) == 1
    assert len(two_at_once([DrivePeriod("s1", "giraff", 0.0, None), second])) == 1, (
        "the first never ended"
    )


def test_an_epoch_is_one_sessions_as_states_and_leases_tell():
    stored = states(1, 2) + states(3, session="s2", epoch=2)
    assert (
        shared_epochs(stored, [("giraff", 1, "s1"), ("giraff", 2, "s2"), ("rhodon", 1, "s3")]) == []
    )
    assert len(shared_epochs(stored, [("giraff", 1, "s2")])) == 1
    assert len(shared_epochs(stored + states(4, session="s2", epoch=1), [])) == 1


def test_a_state_that_is_lost_or_stored_twice_or_known_to_be_missing_is_told():
    assert lost({"s1": 3}, states(1, 2, 3), {}) == []
    assert len(lost({"s1": 3}, states(1, 3), {})) == 1
    assert len(lost({}, states(1, 1), {})) == 1
    assert lost({}, states(1) + states(1, boot="after a restart"), {}) == []
    assert len(lost({}, [], {"s1": 2})) == 1


def test_a_robot_may_move_in_a_drive_and_come_to_rest_after_it_and_no_more():
    drives = [
        DrivePeriod("s1", "giraff", 10.0, 20.0),
        DrivePeriod("s2", "giraff", 20.5, 30.0),
        DrivePeriod("s3", "rhodon", 0.0, None),
    ]
    assert (
        moved_alone({"giraff": [(10.0, 20.0 + LEAVE_SECONDS)], "rhodon": [(1.0, 99.0)]}, drives)
        == []
    )
    assert moved_alone({"giraff": [(19.0, 21.0)]}, drives) == [], "from one drive into the next"
    assert len(moved_alone({"giraff": [(9.9, 11.0)]}, drives)) == 1
    assert len(moved_alone({"giraff": [(29.0, 30.1 + LEAVE_SECONDS)]}, drives)) == 1
    assert moved_alone({"giraff": [(29.0, 30.1 + LEAVE_SECONDS)]}, drives, late=0.2) == []
    assert len(moved_alone({"ghost": [(1.0, 2.0)]}, drives)) == 1


def test_a_base_moves_from_a_velocity_to_the_next_zero_or_until_its_watchdog_strikes():
    assert motion([(0.0, False), (1.0, True), (1.1, True), (1.2, False)]) == [(1.0, 1.2)]
    assert motion([(1.0, True), (1.1, True)]) == [(1.0, 1.1 + WATCHDOG)]
    assert motion([(1.0, True), (5.0, True), (5.1, False)]) == [(1.0, 1.0 + WATCHDOG), (5.0, 5.1)]
    assert motion([]) == []


def test_the_longest_pause_is_one_that_ends_beside_the_crash_and_within_one_drive():
    first, second = [0.0, 0.1, 5.0, 5.1], [7.0, 7.1, 20.0]
    assert longest_pause([first, second], 4.0, 5.05) == 4.9, "it began before"
    assert longest_pause([first, second], 1.0, 4.5) == 0.0, "it is the next crash's"
    assert round(longest_pause([first, second], 5.05, 7.2), 3) == 0.1, "drives end"
    assert longest_pause([[], [1.0]], 0.0, 9.0) == 0.0
