"""What stops the robot's own navigation without the agent (`run_robot NAME --check`)."""

import asyncio
import dataclasses
import math

import pytest

from robots.agent.control.navigation_check import (
    CutResult,
    NavigationCheckParams,
    stopping_distance,
    verdict,
)
from robots.agent.control.robot_check import CheckParams, RobotCheck
from robots.agent.robot_interface import NOWHERE, AdapterError
from tests.support.agents.navigating_base import LOCALIZED, NavigatingBase, Sealed, ThroughAgent
from tests.support.virtual_time import VirtualTime

QUICK = CheckParams(listening=0.2, driving=0.4, longest=1.5, picture=1.0, stood=0.2)


@pytest.fixture
def time():
    with VirtualTime() as time:
        yield time


def begun(time, base):
    lines = []
    return time.loop.create_task(RobotCheck(base, lines.append, params=QUICK).run()), lines


def tried(time, base):
    work, lines = begun(time, base)
    return time.run(work), lines


# --- decisions ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("metres", "moves", "stopped"),
    [(0.0, False, True), (0.2, False, True), (0.21, False, False), (0.05, True, False)],
)
def test_a_robot_was_stopped_when_it_rests_within_its_stopping_distance(metres, moves, stopped):
    assert CutResult(metres, 3.2, moves, allowed=0.2).stopped is stopped


@pytest.mark.parametrize(
    ("stated", "is_well", "words"),
    [
        ("agent", False, "Nothing but the agent may publish velocities"),
        ("guarded", False, "states a guard, but that did not act within 0.65 s"),
        ("unguarded", True, "The profile allows that"),
        (None, False, "Let its velocities pass through the agent"),
    ],
)
def test_a_robot_that_drives_on_passes_only_if_its_profile_allows_that(stated, is_well, words):
    well, line = verdict(CutResult(0.42, 3.2, True, allowed=0.2), stated)
    assert well is is_well
    assert "3.2 s after the connection was cut, the robot had driven 0.42 m" in line
    assert "still moving" in line
    assert words in line


def test_a_stopping_distance_is_that_of_reaction_and_braking(time):
    params = NavigationCheckParams()
    guarded = NavigatingBase(time.times, "guarded").profile
    # from 0.1 m/s with 0.4 m/s² for 0.65 s, then braking with 0.8 m/s²
    assert stopping_distance(guarded, params, 0.1, 0.4) == pytest.approx(
        0.36 * 0.65 + 0.36**2 / 1.6 + 0.05
    )
    through = dataclasses.replace(guarded, navigation_control="agent", watchdog=2.0)
    assert stopping_distance(through, params, 0.1, 0.4) == pytest.approx(0.4 + 0.025 + 0.05)


# --- trials ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "control", "words"),
    [
        (ThroughAgent, "agent", "Navigation passes through the agent: 3."),
        (NavigatingBase, "guarded", "Navigation is guarded: 3."),
    ],
)
def test_guarded_navigation_passes_with_metres_and_seconds(time, kind, control, words):
    base = kind(time.times, control)
    for _ in range(2):
        is_well, lines = tried(time, base)
        assert is_well, lines
        assert words in lines[-1]
        assert "s after the connection was cut, the robot was at rest, 0." in lines[-1]
    (goal, _) = base.goals
    ahead = math.hypot(goal.x - LOCALIZED.x, goal.y - LOCALIZED.y)
    assert ahead >= 0.5
    assert math.atan2(goal.y - LOCALIZED.y, goal.x - LOCALIZED.x) == pytest.approx(LOCALIZED.theta)


@pytest.mark.parametrize("speed", [0.05, 0.1, 0.3, 0.5])
@pytest.mark.parametrize(
    ("stated", "is_well"), [("guarded", False), (None, False), ("unguarded", True)]
)
def test_unguarded_navigation_is_detected_at_any_speed(time, stated, is_well, speed):
    base = NavigatingBase(time.times, "unguarded", stated, speed=speed)
    well, lines = tried(time, base)
    assert well is is_well
    assert "Navigation is unguarded: 3." in lines[-1]
    assert base.left == 0.0, "the goal does not outlive the check"
    assert base.cancelled


@pytest.mark.parametrize("speed", [0.05, 0.1, 0.3, 0.5])
def test_a_guard_is_recognized_at_any_speed(time, speed):
    is_well, lines = tried(time, NavigatingBase(time.times, "guarded", speed=speed))
    assert is_well, lines


def test_a_guard_that_is_late_does_not_count_as_one(time):
    is_well, lines = tried(time, NavigatingBase(time.times, "guarded", guard=2.0))
    assert not is_well
    assert "Navigation is unguarded" in lines[-1]


def test_a_planner_that_bypasses_the_agent_is_detected_before_the_cut(time):
    base = ThroughAgent(time.times, "unguarded", "agent")
    is_well, lines = tried(time, base)
    assert not is_well
    assert "does not pass through the agent: the robot moved before the agent had sent" in lines[-1]
    assert "Cutting the connection…" not in lines
    assert base.left == 0.0


def test_the_agent_passes_on_a_planners_velocity_slowly_while_it_is_checked(time):
    base = ThroughAgent(time.times, "agent", speed=0.5)
    work, lines = begun(time, base)
    time.wait(lambda: "Cutting the connection…" in lines, within=10.0)
    assert base.told[1].linear == pytest.approx(0.2)
    time.run(work)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"pose": NOWHERE}, "not tested, the robot does not know its position"),
        ({"docked": True}, "not tested, the robot is docked"),
        ({"refuses": "the map is missing"}, "the goal was not taken: the map is missing"),
        ({"fails": "no path"}, "the goal ended at once: no path"),
        ({"speed": 0.0}, "did not set out within 20 s"),
    ],
)
def test_navigation_that_cannot_be_tried_fails_with_the_reason(time, fields, words):
    base = NavigatingBase(time.times, "guarded")
    for name, value in fields.items():
        setattr(base, name, value)
    is_well, lines = tried(time, base)
    assert not is_well
    assert words in lines[-1]


def test_an_adapter_that_cannot_cut_its_connection_does_not_pass(time):
    is_well, lines = tried(time, Sealed(time.times, "guarded"))
    assert not is_well
    assert "cannot cut its connection" in lines[-1]


def test_an_unconfirmed_end_of_a_goal_is_reported(time):
    base = NavigatingBase(time.times, "guarded")
    base.confirms = False
    _, lines = tried(time, base)
    assert len(base.cancelled) > 15, "it is cancelled again every half second"
    assert "has not confirmed that its goal was cancelled" in lines[-1]


def test_a_check_that_is_interrupted_during_the_cut_still_cancels_the_goal(time):
    base = NavigatingBase(time.times, "unguarded", speed=0.06)
    work, lines = begun(time, base)
    time.wait(lambda: not base.connected and base.goals, within=10.0)
    work.cancel()
    with pytest.raises(asyncio.CancelledError):
        time.run(work)
    assert base.left == 0.0
    assert "Cutting the connection…" in lines


def test_a_robot_that_cannot_be_reached_after_the_cut_is_reported(time):
    base = NavigatingBase(time.times, "guarded")
    work, lines = begun(time, base)
    time.wait(lambda: not base.connected and base.goals, within=10.0)
    base.unreachable = "the robot is gone"
    with pytest.raises(AdapterError, match="the robot is gone"):
        time.run(work)
    assert "has not confirmed that its goal was cancelled" in lines[-1]
