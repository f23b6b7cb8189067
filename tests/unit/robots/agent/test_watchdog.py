"""When a loop counts as hung."""

from robots.agent.watchdog import HangDetector


def test_a_loop_hangs_after_several_checks_without_a_tick():
    detector = HangDetector(3)
    found = [detector.look(ticks) for ticks in (1, 2, 2, 2, 3, 3, 3, 3, 3)]
    assert found == [False] * 7 + [True] * 2


def test_one_check_after_a_long_pause_is_no_hang():
    detector = HangDetector(3)
    assert not detector.look(7)
    assert not detector.look(7), "a process that was suspended looks once before its loop ticks"
    assert not detector.look(8)
