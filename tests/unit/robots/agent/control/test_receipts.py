"""Receipts of the driver's words from the robot's displays."""

import pytest

from robots.agent.control.receipts import KEPT, Receipts


@pytest.fixture
def receipts():
    made = Receipts()
    made.sent("a1", "s1")
    return made


def test_better_receipt_replaces_a_worse_one_and_never_the_reverse(receipts):
    assert receipts.of("a1") is None
    for session in ("s2", None):
        assert receipts.confirm("a1", "shown", session) == ("unknown_words", False)
    states = ("shown", "shown", "not_spoken", "spoken", "not_spoken", "shown")
    answers = [receipts.confirm("a1", state, "s1") for state in states]
    assert answers == [("", is_news) for is_news in (True, False, True, True, False, False)]
    assert receipts.of("a1") == ("s1", "spoken")


def test_only_the_newest_words_are_remembered(receipts):
    for number in range(KEPT):
        receipts.sent(f"b{number}", "s1")
    assert receipts.confirm("a1", "shown", "s1") == ("unknown_words", False)
    assert receipts.confirm("b0", "shown", "s1") == ("", True)
