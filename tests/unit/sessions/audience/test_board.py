"""Hands and questions, in one web process and in several."""

import itertools

import pytest
from hypothesis import given, strategies as st

from sessions.audience.board import (
    HAND_SECONDS,
    MAX_NAMES,
    MAX_OWN,
    MAX_WAITING,
    QUESTION_PAUSE,
    Asked,
    Board,
    RaisedHand,
    sanitize,
)
from sessions.protocol import AudienceState

KEYS = itertools.count()


def opened(process="a"):
    board = Board(process)
    board.begin("s1")
    return board


def raises(board, user, stamp=1.0, page=None):
    key = f"h{next(KEYS)}"
    return board.raise_hand(page or user, RaisedHand(key, user, user.title(), stamp))


def asks(board, user, stamp=1.0, text="Why?"):
    key = f"q{next(KEYS)}"
    assert board.ask(Asked(key, user, user.title(), text, stamp)) == ""
    return key


def talk(*boards, now=1.0):
    """Exchange updates until no board changes."""
    before = None
    while (versions := [board.version for board in boards]) != before:
        before = versions
        updates = [update for board in boards if (update := board.update()) is not None]
        behind = [other.merge(update, now) for update in updates for other in boards]
        if any(behind):
            before = None


def names(board):
    return board.view("", moderates=True).names


def states(board, user="", *, moderates=True):
    return [(one.text, one.state) for one in board.view(user, moderates=moderates).questions]


def test_a_board_without_a_drive_is_closed():
    board = Board("a")
    assert raises(board, "ada") == "closed"
    assert board.ask(Asked("q", "ada", "Ada", "Why?", 1.0)) == "closed"
    assert board.view("ada", moderates=True) == AudienceState()
    assert board.update() is None


def test_hands_are_listed_in_the_order_in_which_they_were_raised_one_a_person():
    board = opened()
    raises(board, "bob", 2.0)
    raises(board, "ada", 1.0)
    raises(board, "bob", 3.0, page="bob's other page")
    assert names(board) == ("Ada", "Bob")
    assert board.view("ada").raised
    assert not board.view("eve").raised


def test_one_question_is_being_answered_at_a_time():
    board = opened()
    first, second = asks(board, "ada", 1.0, "One?"), asks(board, "bob", 2.0, "Two?")
    board.mark(first, "answering")
    board.mark(second, "answering")
    assert states(board) == [("Two?", "answering")]
    assert states(board, "ada", moderates=False) == [("One?", "answered"), ("Two?", "answering")]
    assert board.mark("q-of-nobody", "answered") == "unknown"


def test_a_person_has_a_limit_of_questions_and_a_pause_between_them():
    board = opened()
    asks(board, "ada", 0.0)
    assert board.ask(Asked("x", "ada", "Ada", "And?", QUESTION_PAUSE - 0.1)) == "rate"
    keys = [asks(board, "ada", QUESTION_PAUSE * n) for n in range(1, MAX_OWN)]
    late = QUESTION_PAUSE * MAX_OWN
    assert board.ask(Asked("y", "ada", "Ada", "And?", late)) == "too_many"
    board.mark(keys[0], "answered")
    asks(board, "ada", late)


def test_a_list_with_too_many_questions_is_full():
    board = opened()
    keys = [asks(board, f"user{n}") for n in range(MAX_WAITING)]
    assert board.ask(Asked("x", "ada", "Ada", "Why?", 1.0)) == "full"
    board.mark(keys[0], "answered")
    asks(board, "ada")


@pytest.mark.parametrize(
    ("said", "kept"),
    [
        ("  Why\n\tnot?  ", "Why not?"),
        ("<b>&amp;</b>", "<b>&amp;</b>"),
        ("a\x00\x1b[31mb", "a[31mb"),
        ("\n \x00", ""),
        ("\u200b\u2060 \u0301", ""),
        ("\u202eabc\u2066", "abc"),
        ("\N{FAMILY}\u200d\N{BOY} ?", "\N{FAMILY}\u200d\N{BOY} ?"),
        ("\u0645\u0627\u061f", "\u0645\u0627\u061f"),
    ],
)
def test_a_question_is_one_line_of_plain_text(said, kept):
    assert sanitize(said) == kept


def test_an_empty_question_is_refused():
    assert opened().ask(Asked("x", "ada", "Ada", sanitize(" \n "), 1.0)) == "empty"


# --- several web processes ------------------------------------------------------------------------


def test_two_processes_have_one_list():
    one, two = opened("a"), opened("b")
    raises(one, "ada", 1.0)
    raises(two, "bob", 2.0)
    key = asks(one, "ada")
    talk(one, two)
    assert names(one) == names(two) == ("Ada", "Bob")
    two.mark(key, "answering")
    talk(one, two)
    assert states(one) == states(two) == [("Why?", "answering")]
    two.lower_all()
    talk(one, two)
    assert names(one) == names(two) == ()
    assert not one.view("ada").raised


def test_a_process_that_starts_late_or_misses_an_update_gets_everything():
    one, two, late = opened("a"), opened("b"), opened("c")
    key = asks(one, "ada")
    talk(one, two)
    one.mark(key, "answering")
    one.update()  # which is lost
    raises(one, "bob")
    talk(one, two, late)
    assert states(one) == states(two) == states(late) == [("Why?", "answering")]
    assert names(late) == ("Bob",)


def test_a_repeated_update_changes_nothing():
    one, two = opened("a"), opened("b")
    raises(one, "ada")
    asks(one, "ada")
    talk(one, two)
    before = one.version, two.version
    talk(one, two)
    assert (one.version, two.version) == before


def test_a_lost_process_loses_its_hands_and_not_its_questions():
    one, two = opened("a"), opened("b")
    raises(one, "ada")
    asks(one, "ada")
    talk(one, two, now=100.0)
    two.expire(100.0 + HAND_SECONDS - 1.0)
    assert names(two) == ("Ada",)
    two.expire(100.0 + HAND_SECONDS)
    assert names(two) == ()
    assert states(two) == [("Why?", "waiting")]


def test_a_hand_stays_raised_when_its_page_reconnects_to_another_process():
    one, two = opened("a"), opened("b")
    raises(one, "ada", 1.0)
    raises(one, "bob", 2.0)
    raises(two, "cy", 3.0)
    talk(one, two, now=100.0)
    raises(two, "ada", 50.0)
    two.expire(100.0 + HAND_SECONDS)
    assert names(two) == ("Ada", "Cy"), "the hand keeps its place"
    assert two.lower_hand("ada") == ""
    assert names(two) == ("Cy",)


def test_a_hand_stays_raised_when_the_previous_connection_of_its_page_closes():
    board = opened()
    raises(board, "ada", 1.0, page="first")
    raises(board, "ada", 2.0, page="second")
    board.leave("first")
    assert names(board) == ("Ada",)
    board.leave("second")
    assert names(board) == ()


def test_600_hands_of_three_processes_are_one_list():
    boards = [opened(process) for process in "abc"]
    for number in range(600):
        raises(boards[number % 3], f"user{number}", float(number))
    talk(*boards)
    for board in boards:
        seen = board.view("", moderates=True)
        assert (seen.hands, len(seen.names), seen.names[0]) == (600, MAX_NAMES, "User0")
    boards[0].lower_all()
    talk(*boards)
    assert [board.view("", moderates=True).hands for board in boards] == [0, 0, 0]


def test_updates_of_another_drive_are_ignored():
    one, two = opened("a"), opened("b")
    two.begin("s2")
    asks(one, "ada")
    talk(one, two)
    assert states(two) == []


@given(
    st.lists(
        st.tuples(
            st.integers(0, 2),
            st.sampled_from(["ask", "answering", "answered", "declined", "talk"]),
            st.integers(0, 5),
        ),
        max_size=25,
    )
)
def test_all_boards_agree_after_any_changes(steps):
    boards = [opened(process) for process in "abc"]
    keys = []
    for clock, (at, step, which) in enumerate(steps):
        if step == "ask":
            keys.append(asks(boards[at], f"user{len(keys)}", float(clock)))
        elif step == "talk":
            talk(*boards)
        elif keys:
            boards[at].mark(keys[which % len(keys)], step)
    talk(*boards)
    assert len({board.digest for board in boards}) == 1
    assert states(boards[0]) == states(boards[1]) == states(boards[2])
