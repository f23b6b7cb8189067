"""What is known of the driver's words at the robot's displays."""

import pytest

from robots.agent.control.receipts import KEPT, Receipts


@pytest.fixture
def receipts():
    made = Receipts()
    made.sent("a1", "s1")
    return made


def test_words_have_no_receipt_before_a_display_confirms_them(receipts):
    assert receipts.of("a1") is None
    assert receipts.of("never said") is None


def test_better_receipt_replaces_a_worse_one_and_never_the_reverse(receipts):
    said = [
        receipts.confirm("a1", state, "s1")
        for state in ("shown", "shown", "not_spoken", "spoken", "not_spoken", "shown")
    ]
    news = [is_news for reason, is_news in said if reason == ""]
    assert news == [True, False, True, True, False, False]
    assert receipts.of("a1") == ("s1", "spoken")


@pytest.mark.parametrize(("target", "session"), [("a2", "s1"), ("a1", "s2"), ("a1", None)])
def test_unknown_words_and_those_of_another_session_are_not_confirmed(receipts, target, session):
    assert receipts.confirm(target, "shown", session) == ("unknown_words", False)
    assert receipts.of("a1") is None


def test_only_the_newest_words_are_remembered(receipts):
    for number in range(KEPT):
        receipts.sent(f"b{number}", "s1")
    assert receipts.confirm("a1", "shown", "s1") == ("unknown_words", False)
    assert receipts.confirm("b0", "shown", "s1") == ("", True)
