"""When a robot is docked: contact, standstill and released controls, without a break, for as long
as the rule says.
"""

from dataclasses import replace

import pytest
from hypothesis import given, strategies as st

from robots.api.docked import APART, DOCKED, DockReading, follow
from tests.support.examples import examples

PERIOD = 0.02


def after(*spans, before=APART, period=PERIOD):
    """Follow spans of (seconds, contact, fields of the reading)."""
    state, at = before, 0.0 if before.at is None else before.at + period
    for seconds, contact, *fields in spans:
        for _ in range(round(seconds / period)):
            state = follow(
                DOCKED, state, DockReading(at=at, contact=contact, **(fields[0] if fields else {}))
            )
            at += period
    return state


def test_a_robot_that_rests_on_its_contacts_for_two_seconds_is_docked():
    assert not after((1.9, True)).docked
    assert after((2.1, True)).docked


@pytest.mark.parametrize("fields", [{"linear": 0.05}, {"angular": -0.1}, {"released": False}])
def test_a_robot_that_moves_on_its_contacts_is_not_docked_until_it_rests(fields):
    pushing = after((10.0, True, fields))
    assert pushing.touching
    assert not pushing.docked
    assert not after((1.9, True), before=pushing).docked
    assert after((2.1, True), before=pushing).docked


def test_a_short_break_of_the_contacts_restarts_the_time():
    assert not after((1.9, True), (0.04, False), (1.9, True)).docked


def test_a_docked_robot_stays_docked_while_its_contacts_bounce_or_it_moves_on_them():
    docked = after((3.0, True))
    assert after((0.4, False), (0.1, True), (0.4, False), before=docked).docked
    assert after((5.0, True, {"released": False, "angular": 0.2}), before=docked).docked
    assert not after((0.6, False), before=docked).docked


def test_a_gap_in_the_readings_restarts_the_time_at_rest():
    first = follow(DOCKED, APART, DockReading(at=0.0, contact=True))
    late = follow(DOCKED, first, DockReading(at=5.0, contact=True))
    assert not late.docked
    assert late.resting_since == 5.0


def test_four_states_a_second_are_enough():
    assert after((2.25, True), period=0.25).docked
    assert not after((2.0, True), period=0.25).docked


READING = st.tuples(
    st.sampled_from([0.02, 0.25, 0.5, 1.5]),
    st.booleans(),
    st.sampled_from([0.0, 0.02, 0.2]),
    st.booleans(),
)


@examples(50, thorough=1000)
@given(readings=st.lists(READING, max_size=60), seconds=st.sampled_from([0.5, 1.0, 2.0]))
def test_no_robot_is_docked_that_has_not_rested_without_a_break(readings, seconds):
    rule, state, at, rested, last = replace(DOCKED, seconds=seconds), APART, 0.0, None, 0.0
    for step, contact, linear, released in readings:
        at += step
        was = state.docked
        state = follow(
            rule, state, DockReading(at=at, contact=contact, linear=linear, released=released)
        )
        rests = contact and linear <= rule.linear and released
        rested = None if not rests else at if rested is None or at - last > rule.gap else rested
        last = at
        if state.docked and not was:
            assert rested is not None
            assert at - rested >= seconds - 1e-6
        assert state.touching or not state.docked
