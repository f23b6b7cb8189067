"""Actions that an RCA has received, and how they end."""

import pytest

from robots.agent.adapters.common.pending_actions import PendingAction, PendingActions
from robots.agent.robot_interface import ActionRefusedError
from robots.api.docked import DockState

APART, TOUCHING = DockState(), DockState(touching=True)
SEATED = DockState(touching=True, docked=True)


def made():
    """Return pending actions and the list of their progress."""
    news = []
    return PendingActions(lambda one: news.append((one.action_id, one.status, one.reason))), news


def test_a_second_action_of_the_base_is_refused_until_the_first_has_ended():
    pending_actions, news = made()
    pending_actions.begin(PendingAction("g", "goto", 0.0, (1.0, 1.0)))
    pending_actions.begin(PendingAction("t", "tilt", 0.0, (0.2, 0.2)))
    with pytest.raises(ActionRefusedError, match="navigation_does_not_end"):
        pending_actions.own(PendingAction("d", "dock", 0.0))
    assert pending_actions.of("t") is not None
    pending_actions.end("g", "CANCELLED")
    pending_actions.own(PendingAction("d", "dock", 0.0))
    assert news == [("g", "RUNNING", ""), ("t", "RUNNING", ""), ("g", "CANCELLED", "")]
    assert pending_actions.of("d") is not None


def test_an_action_of_the_base_stays_ours_after_the_connection_was_lost():
    pending_actions, news = made()
    pending_actions.begin(PendingAction("g", "goto", 0.0, (1.0, 1.0)))
    pending_actions.end_all("the cable was pulled")
    assert news == [("g", "RUNNING", "")]
    pending_actions.end_all("again")
    pending_actions.end("g", "CANCELLED")
    assert news[1:] == [("g", "FAILED", "the cable was pulled")]
    assert pending_actions.drive is None


def test_an_action_that_is_not_accepted_yet_is_not_ended_by_the_dock():
    pending_actions, news = made()
    pending_actions.own(PendingAction("u", "undock", 0.0))
    pending_actions.watch(1.0, dock=APART, tilt=None)
    assert pending_actions.of("u") is not None
    pending_actions.disown("u")
    assert (pending_actions.of("u"), news) == (None, [])


def test_docking_is_done_in_the_dock_and_undocking_out_of_it():
    pending_actions, news = made()
    pending_actions.begin(PendingAction("d", "dock", 0.0))
    pending_actions.watch(1.0, dock=APART, tilt=None)
    pending_actions.watch(1.5, dock=TOUCHING, tilt=None)
    assert news == [("d", "RUNNING", "")]
    pending_actions.watch(2.0, dock=SEATED, tilt=None)
    pending_actions.begin(PendingAction("u", "undock", 2.0))
    pending_actions.watch(3.0, dock=TOUCHING, tilt=None)
    pending_actions.watch(4.0, dock=APART, tilt=None)
    statuses = [(action, status) for action, status, _ in news]
    assert statuses == [(action, end) for action in "du" for end in ("RUNNING", "FINISHED")]


def test_late_action_fails_with_the_reason():
    pending_actions, news = made()
    pending_actions.begin(PendingAction("d", "dock", 0.0, deadline=10.0))
    pending_actions.begin(PendingAction("t", "tilt", 0.0, (0.5, 0.5), 5.0))
    pending_actions.watch(6.0, dock=APART, tilt=0.1)
    pending_actions.watch(11.0, dock=APART, tilt=0.1)
    assert news[2:] == [("t", "FAILED", "not_in_time")]
    assert pending_actions.drive.failure == "not_in_time"
    pending_actions.end("d", "CANCELLED", "cancelled")  # once the RCA has confirmed it
    assert news[3:] == [("d", "FAILED", "not_in_time")]


def test_tilt_finishes_when_the_head_has_its_angle():
    pending_actions, news = made()
    pending_actions.begin(PendingAction("t", "tilt", 0.0, (0.5, 0.5), 5.0))
    pending_actions.watch(1.0, dock=APART, tilt=0.4)
    pending_actions.watch(2.0, dock=APART, tilt=0.49)
    assert news[-1] == ("t", "FINISHED", "")


def test_action_ends_once_and_no_other_with_it():
    pending_actions, news = made()
    pending_actions.begin(PendingAction("d", "dock", 0.0))
    pending_actions.end_drive("FINISHED", "", "goto")  # an end of navigation is not one of docking
    pending_actions.end("d", "FAILED", "blocked")
    pending_actions.end("d", "FINISHED")
    pending_actions.end_all("gone")
    assert news == [("d", "RUNNING", ""), ("d", "FAILED", "blocked")]


def test_head_and_localization_fail_with_the_connection():
    pending_actions, news = made()
    pending_actions.begin(PendingAction("t", "tilt", 0.0, (0.5, 0.5)))
    pending_actions.begin(PendingAction("r", "relocalize", 0.0))
    pending_actions.end_all("the robot was lost")
    assert news[2:] == [(action, "FAILED", "the robot was lost") for action in "tr"]
