"""A velocity is sent after an answer of the peer, with a limited number for each reading."""

import pytest
from hypothesis import given, strategies as st

from robots.agent.adapters.common.velocity_gate import GateParams, VelocityGate
from robots.agent.ramp import ZERO
from robots.api.messages import Velocity

AHEAD, ASIDE = Velocity(linear=0.2, angular=0.0), Velocity(linear=0.2, angular=0.3)
PARAMS = GateParams()


@pytest.fixture
def gate():
    return VelocityGate(PARAMS, 0.0)


def sent(gate, velocity, asked, answered):
    gate.want(velocity, asked)
    assert gate.ask(asked)
    return gate.answered(answered)


def test_only_one_question_is_open_and_its_answer_gets_the_newest_velocity(gate):
    gate.want(AHEAD, 0.1)
    assert gate.ask(0.1)
    gate.want(ASIDE, 0.12)
    assert not gate.ask(0.12)
    assert gate.answered(0.13) == ASIDE
    assert gate.answered(0.14) is None


def test_the_gate_shuts_without_an_answer_and_ignores_a_late_one(gate):
    gate.want(AHEAD, 0.1)
    gate.ask(0.1)
    gate.received(0.3)
    assert gate.shut(0.34) == ""
    assert gate.shut(0.36) == "does not answer"
    gate.want(AHEAD, 4.1)
    gate.received(4.1)
    assert gate.answered(4.1) is None
    assert gate.unanswered(4.1) == 0.0
    assert gate.shut(4.1) == ""


def test_a_velocity_that_waited_is_not_sent(gate):
    gate.want(AHEAD, 0.0)
    assert not gate.ask(0.26)
    gate.received(0.5)
    gate.want(AHEAD, 0.5)
    gate.ask(0.7)
    assert gate.answered(0.76) is None


def test_each_reading_permits_three_velocities_that_differ(gate):
    speeds = [Velocity(linear=0.01 * number, angular=0.0) for number in range(1, 6)]
    found = []
    for number, speed in enumerate(speeds):
        gate.want(speed, 0.02 * number)
        found.append(gate.ask(0.02 * number) and gate.answered(0.02 * number) == speed)
    assert found == [True, True, True, False, False]
    gate.received(0.1)
    assert gate.ask(0.1)


def test_an_unchanged_velocity_is_repeated_after_a_reading_or_a_while(gate):
    sent(gate, AHEAD, 0.0, 0.0)
    gate.want(AHEAD, 0.1)
    assert not gate.ask(0.1)
    gate.received(0.11)
    assert gate.ask(0.11)
    assert gate.answered(0.11) == AHEAD
    gate.want(AHEAD, 0.37)
    assert gate.ask(0.37)


def test_a_silent_robot_is_not_moved_and_a_slow_one_has_more_time():
    gate = VelocityGate(PARAMS, 0.0)
    assert gate.shut(0.39) == ""
    assert gate.shut(0.41) == "does not report its state"
    now = 0.0
    for _ in range(40):
        now += 0.45
        gate.received(now)
    assert gate.shut(now + 0.8) == ""
    assert gate.shut(now + 0.95) == "does not report its state"


@given(
    st.lists(
        st.tuples(
            st.sampled_from(["want", "stand", "receive", "ask", "answer"]), st.floats(0.0, 0.5)
        ),
        max_size=60,
    )
)
def test_no_velocity_is_sent_without_a_recent_answer_and_a_fresh_reading(steps):
    gate, now, received_at, asked, since = VelocityGate(PARAMS, 0.0), 0.0, 0.0, None, 0
    for number, (step, pause) in enumerate(steps):
        now += pause
        match step:
            case "want":
                gate.want(Velocity(linear=0.01 * (number + 1), angular=0.0), now)
            case "stand":
                gate.stood(now)
            case "receive":
                gate.received(now)
                received_at, since = now, 0
            case "ask" if gate.ask(now):
                assert asked is None
                asked = now
            case "answer" if asked is not None:
                velocity, asked_at, asked = gate.answered(now), asked, None
                if velocity is not None:
                    since += 1
                    assert velocity != ZERO
                    assert now - asked_at <= PARAMS.patience
                    assert now - received_at <= PARAMS.longest
                    assert since <= PARAMS.orders
