import pytest

from robots.api import messages as m
from sessions.manager.robot_liveness import RobotLiveness
from sessions.visitor_motion import VisitorMotion
from tests.support import words

UNDER_WAY = m.Velocity(linear=0.2, angular=0.0)
RESTING = m.Velocity(linear=0.02, angular=0.03)


def moves(*states: dict[str, object], first: int = 1) -> list[bool]:
    """Whether the robot moves for its visitor in each of these consecutive states."""
    motion = VisitorMotion()
    return [motion.take(words.state(first + n, **one)) for n, one in enumerate(states)]


def by_itself(mode: str, *, velocity: m.Velocity = UNDER_WAY, docked: bool = False) -> dict:
    return {"mode": mode, "velocity": velocity, "docked": docked}


def steered(linear: float, angular: float = 0.0) -> dict:
    return {"applied": (words.applied(linear=linear, angular=angular),)}


def test_an_applied_velocity_moves_the_robot_for_its_visitor():
    assert moves({}, steered(0.0), steered(0.2), steered(0.0, -0.3)) == [False, False, True, True]


def test_a_robot_on_the_way_to_a_goal_moves_for_its_visitor_once_it_is_not_at_rest():
    waiting = by_itself("goto", velocity=RESTING, docked=True)
    assert moves({"docked": True}, waiting, by_itself("goto")) == [False, False, True]


def test_leaving_the_dock_by_itself_is_no_motion_for_the_visitor():
    leaving = [by_itself("docking", docked=n == 0) for n in range(3)]
    assert not any(moves({"docked": True}, *leaving, {}))
    assert not any(moves({"docked": True}, *leaving[1:], {}))
    assert not any(moves(*leaving))


def test_returning_to_the_dock_is_motion_for_the_visitor_who_requested_it():
    returning = by_itself("docking")
    leaving = by_itself("docking", docked=True)
    docked = by_itself("docking", docked=True, velocity=RESTING)
    assert moves(leaving, returning, {}, returning, returning, docked) == [
        *(False, False, False),
        *(True, True, False),
    ]


@pytest.mark.parametrize("lost", [1, 5])
def test_a_docking_that_begins_among_lost_states_may_be_an_undocking(lost):
    motion = VisitorMotion()
    assert not motion.take(words.state(1))
    for n in range(3):
        assert not motion.take(words.state(2 + lost + n, **by_itself("docking")))


def test_the_session_manager_notes_motion_by_the_same_rule():
    drive = {"session": "s1", "epoch": 1}
    states = (
        {**drive, "docked": True},
        {**drive, **by_itself("docking")},
        drive,
        by_itself("goto"),  # between sessions
        {**drive, **by_itself("goto")},
    )
    liveness, noted = RobotLiveness(), []
    for seq, state in enumerate(states, start=1):
        liveness.take(words.state(seq, **state), float(seq))
        noted.append(liveness.link(0.0).moved)
    assert noted == [False, False, False, False, True]
