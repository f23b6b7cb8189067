"""When a goal of move_base has certainly ended, by the status that its server publishes."""

import pytest

from robots.agent.adapters.ros.navigators import move_base
from robots.agent.adapters.ros.navigators.move_base import MoveBase, MoveBaseParams
from robots.agent.robot_interface import ActionRefusedError
from tests.support.architectures.fake_ros_bus import FakeBus

PENDING, ACTIVE, PREEMPTED, RECALLING = 0, 1, 2, 7
TARGET = {"header": {}, "pose": {}}


class Goals:
    def __init__(self):
        self.news = []

    def accepted(self, goal):
        self.news.append((goal, "accepted"))

    def ended(self, goal, status, reason):
        self.news.append((goal, status, reason))


class Rig:
    def __init__(self, monkeypatch):
        self.now, self.bus, self.goals = 100.0, FakeBus(), Goals()
        monkeypatch.setattr(move_base.time, "monotonic", lambda: self.now)
        self.navigator = MoveBase("/move_base", self.bus, self.goals, MoveBaseParams())
        self.status()

    def status(self, after=0.2, **listed):
        """The server publishes its status, goals by id."""
        self.now += after
        entries = [
            {"goal_id": {"id": goal.replace("_", "-")}, "status": status, "text": ""}
            for goal, status in listed.items()
        ]
        self.navigator._status({"status_list": entries})

    @property
    def cancelled(self):
        return [content["id"] for topic, content in self.bus.published if topic.endswith("/cancel")]


@pytest.fixture
def rig(monkeypatch):
    return Rig(monkeypatch)


async def test_a_goal_is_refused_where_no_status_is_published(rig):
    rig.now += 2.1
    with pytest.raises(ActionRefusedError, match="/move_base/status is not published"):
        rig.navigator.send(TARGET, "telepresence-1")
    assert rig.bus.published == []
    assert await rig.navigator.cancel("telepresence-1")


async def test_a_cancel_is_confirmed_only_by_the_terminal_status(rig):
    rig.navigator.send(TARGET, "telepresence-1")
    rig.status(telepresence_1=ACTIVE)
    assert not await rig.navigator.cancel("telepresence-1")
    rig.status(telepresence_1=ACTIVE)
    assert not await rig.navigator.cancel("telepresence-1")
    rig.status(telepresence_1=PREEMPTED)
    assert await rig.navigator.cancel("telepresence-1")
    assert rig.cancelled == ["telepresence-1"] * 2
    assert rig.goals.news[-1] == ("telepresence-1", "CANCELLED", "cancelled")


async def test_a_goal_that_a_restarted_server_does_not_list_has_ended(rig):
    rig.navigator.send(TARGET, "telepresence-1")
    rig.status(telepresence_1=PENDING)
    rig.status()
    assert rig.goals.news[-1] == ("telepresence-1", "FAILED", "navigation_lost: restarted")


async def test_a_goal_that_was_never_received_ends_after_6_s_of_status(rig):
    rig.navigator.send(TARGET, "telepresence-1")
    await rig.navigator.cancel("telepresence-1")
    for _ in range(20):
        rig.status(telepresence_1=RECALLING)
    rig.status(after=10.0, telepresence_1=RECALLING)  # the server hung: it counts from here
    assert not await rig.navigator.cancel("telepresence-1")
    for _ in range(32):
        rig.status(telepresence_1=RECALLING)
    assert rig.goals.news[-1] == ("telepresence-1", "FAILED", "navigation_lost: goal not received")
    assert await rig.navigator.cancel("telepresence-1")


async def test_a_goal_of_an_earlier_run_is_cancelled_until_it_ends(rig):
    for _ in range(6):
        rig.status(telepresence_9=ACTIVE, rviz=ACTIVE)
    rig.status(telepresence_9=PREEMPTED, rviz=ACTIVE)
    rig.status(telepresence_9=PREEMPTED, rviz=ACTIVE)
    assert rig.cancelled == ["telepresence-9"] * 2
    assert rig.goals.news == []


async def test_goals_end_with_their_server(rig):
    rig.navigator.send(TARGET, "telepresence-1")
    rig.navigator.server_ended()
    assert rig.goals.news == [("telepresence-1", "FAILED", "navigation_lost: ended")]
