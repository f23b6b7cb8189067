"""Whose call and knock reaches the people at the robot."""

import pytest

from robots.agent.control.calls import (
    KNOCK_PAUSE,
    KNOCK_REPORTED,
    KNOCK_RINGS,
    NOTHING,
    RINGS,
    CallControl,
    Passing,
)
from robots.api.messages import Call
from tests.support.words import lease


def call(**fields):
    return Call(action_id="a1", stamp=1.0, **{"audio": True, "video": True, **fields})


def status(calls, of=None, now=0.0):
    state = calls.state(of or lease(), now)
    return state and state.status


@pytest.fixture
def calls():
    return CallControl()


def test_no_media_passes_without_a_call(calls):
    assert status(calls) is None
    assert calls.passing(lease(), 0.0) == NOTHING
    assert calls.answer(accept=True, lease=lease(), now=0.0) == "nobody_calls"
    calls.ask(call(), lease(), 0.0)
    assert calls.passing(None, 0.0) == NOTHING, "there is no lease"


def test_a_shared_screen_counts_as_shown_while_the_call_is_accepted(calls):
    calls.rule = "ask"
    calls.ask(call(shares=True), lease(), 0.0)
    assert not calls.shows_screen(lease(), 0.0)
    calls.answer(accept=True, lease=lease(), now=1.0)
    assert calls.shows_screen(lease(), 1.0)
    assert not calls.shows_screen(lease(epoch=2), 1.0)
    assert not calls.shows_screen(None, 1.0)
    calls.ask(call(shares=True, video=False), lease(), 2.0)
    assert not calls.shows_screen(lease(), 2.0)
    calls.ask(call(), lease(), 3.0)
    assert (calls.shows_screen(lease(), 3.0), calls.passing(lease(), 3.0).video) == (False, True)


def test_an_unanswered_call_may_still_be_answered(calls):
    calls.rule = "ask"
    calls.ask(call(), lease(), 0.0)
    assert status(calls, now=RINGS + 1) == "unanswered"
    calls.answer(accept=True, lease=lease(), now=RINGS + 2)
    assert status(calls, now=RINGS + 2) == "accepted"


def test_declined_visitor_is_cut_off_and_rings_again_only_after_hanging_up(calls):
    calls.ask(call(), lease(), 0.0)
    calls.answer(accept=False, lease=lease(), now=1.0)
    assert (status(calls), calls.passing(lease(), 1.0)) == ("declined", NOTHING)
    calls.ask(call(video=False), lease(), 2.0)
    assert status(calls) == "declined"
    calls.rule = "ask"
    calls.ask(call(ringing=False), lease(), 3.0)
    calls.ask(call(), lease(), 4.0)
    assert status(calls, now=4.0) == "ringing"


def test_an_answer_is_valid_for_the_session_and_each_page_starts_muted(calls):
    calls.rule = "ask"
    calls.ask(call(), lease(), 0.0)
    calls.answer(accept=True, lease=lease(), now=1.0)
    again = lease(epoch=2)
    assert calls.passing(again, 2.0) == NOTHING
    calls.ask(call(), again, 3.0)
    assert status(calls, again, 3.0) == "accepted"
    other = lease(session="s2", epoch=3)
    calls.ask(call(), other, 4.0)
    assert status(calls, other, 4.0) == "ringing"


# --- knocks ---------------------------------------------------------------------------------------


def knock(calls, name="k1", now=0.0, of=None, *, audible=True):
    return calls.knock(name, of or lease(), now, audible=audible)


def knocking(calls, now=0.0, of=None):
    state = calls.knocking(of or lease(), now)
    return state and (state.action_id, state.status)


def test_a_knock_rings_until_it_is_answered_or_ends(calls):
    assert knocking(calls) is None
    assert knock(calls) is None
    assert knocking(calls, KNOCK_RINGS) == ("k1", "ringing")
    assert knocking(calls, KNOCK_RINGS + 1) == ("k1", "unanswered")
    assert calls.answer_knock("k1", accept=True, lease=lease(), now=KNOCK_RINGS + 2) is None
    assert knocking(calls, KNOCK_RINGS + 3) == ("k1", "answered")
    assert knocking(calls, KNOCK_REPORTED + 1) is None


def test_an_answered_knock_accepts_a_later_call(calls):
    calls.rule = "ask"
    knock(calls)
    assert (status(calls), calls.passing(lease(), 0.0)) == (None, NOTHING)
    calls.answer_knock("k1", accept=True, lease=lease(), now=1.0)
    assert calls.passing(lease(), 1.0) == NOTHING
    calls.ask(call(), lease(), 2.0)
    assert status(calls, now=2.0) == "accepted"
    assert calls.passing(lease(), 2.0) == Passing(audio=True, video=True)


def test_not_now_keeps_the_robot_quiet_for_the_rest_of_the_session_and_ends_no_call(calls):
    calls.ask(call(), lease(), 0.0)
    knock(calls)
    assert calls.knockable(lease(), audible=True)
    calls.answer_knock("k1", accept=False, lease=lease(), now=1.0)
    assert knocking(calls, 1.0) == ("k1", "declined")
    assert knock(calls, "k2", 1000.0) == "declined"
    assert not calls.knockable(lease(epoch=2), audible=True)
    assert status(calls, now=1.0) == "accepted"
    assert calls.knockable(lease(session="s2"), audible=True)
    assert knock(calls, "k3", 1000.0, lease(session="s2")) is None


def test_knocks_of_all_drivers_together_have_a_pause_between_them(calls):
    knock(calls)
    assert knock(calls, "k2", KNOCK_PAUSE - 0.1) == "too_soon"
    assert knock(calls, "k3", KNOCK_PAUSE - 0.1, lease(session="s2")) == "too_soon"
    assert knock(calls, "k4", KNOCK_PAUSE, lease(session="s2")) is None
    assert knocking(calls, KNOCK_PAUSE) is None, "that of the session before is nobody's"
    assert knocking(calls, KNOCK_PAUSE, lease(session="s2")) == ("k4", "ringing")


def test_knock_without_display_and_loudspeaker_is_refused(calls):
    assert knock(calls, audible=False) == "nobody_there"
    assert calls.knock("k1", None, 0.0, audible=True) == "nobody_there"
    assert not calls.knockable(lease(), audible=False)
    assert not calls.knockable(None, audible=True)


def test_only_the_knock_that_rings_is_answered(calls):
    knock(calls)
    answers = [("k2", lease(), 1.0), ("k1", lease(session="s2"), 1.0), ("k1", None, 1.0)]
    answers.append(("k1", lease(), KNOCK_REPORTED + 1))
    for name, of, now in answers:
        assert calls.answer_knock(name, accept=True, lease=of, now=now) == "nobody_knocks"
    assert knocking(calls, 1.0) == ("k1", "ringing")
