"""Robots that return to their dock between two sessions: their orders, who may drive them, and what
is stored.
"""

from collections import deque

import pytest
from django.db import OperationalError, connection

from accounts.models import User
from robots.api import codec, messages as m
from robots.models import Robot, RobotPermit, RobotPresence
from sessions.leases import store
from sessions.leases.expiry import tick
from sessions.leases.readiness import NETWORK_PAUSE_S, ORDERED
from sessions.leases.transitions import RobotLink, WithdrawOffer
from sessions.manager.return_to_dock import ReturnToDock
from sessions.manager.robot_liveness import RobotLiveness
from sessions.models import SystemLog
from sessions.protocol import Offered
from tests.support import words
from tests.support.robots import online_robot, update_robots
from tests.support.sessions.rows import NOW, after

pytestmark = pytest.mark.django_db
FACTS = {
    "series": "giraff",
    "capabilities": ["velocity", "dock", "tilt"],
    "tilt": {"minimum": -0.5, "maximum": 0.9, "home": 0.28, "speed": 0.8},
}


@pytest.fixture
def giraff():
    return online_robot(factsheet=FACTS)


class Situation:
    """A robot that sends messages to the session manager."""

    def __init__(self):
        self.return_to_dock, self.liveness, self.seq = ReturnToDock(), RobotLiveness(), 0
        self.outbox = deque()

    def report(self, now, *, trip=0.05, **changes):
        """Send a state, and an answer to a heartbeat with this round trip in seconds."""
        self.seq += 1
        self.liveness.take(words.state(self.seq, **{"tilt": 0.28, **changes}), now.timestamp())
        sent = now.timestamp() - trip
        echo = m.Echo(peer="server", n=self.seq, stamp=sent, received=sent + trip / 2)
        self.liveness.heartbeat(
            m.Heartbeat(n=self.seq, stamp=sent + trip / 2, echoes=(echo,)),
            now.timestamp(),
            now.timestamp(),
        )

    def answer(self, action, status, **fields):
        ended = m.ActionStatus(action_id=action.action_id, status=status, stamp=1.0, **fields)
        self.liveness.answer(ended)

    def tick(self, now):
        liveness = {"giraff": self.liveness}
        self.outbox.extend(self.return_to_dock.tick(liveness, now, now.timestamp()))
        published = [codec.decode("command/action", one.payload, "to_robot") for one in self.outbox]
        self.outbox.clear()
        return published


@pytest.fixture
def situation():
    return Situation()


def end_session(robot, visitor, now=NOW):
    granted = store.take(robot, visitor, "p1", now=now)
    assert store.leave(granted.session, peer="p1", now=now)
    return Robot.objects.get(pk=robot.pk)


def test_server_sends_a_robot_to_its_dock_after_a_session(giraff, ana, situation):
    end_session(giraff, ana)
    situation.report(after(1), docked=False)
    (dock,) = situation.tick(after(1))
    assert isinstance(dock, m.Dock)
    assert (dock.role, dock.session, dock.stamp) == ("server", None, after(1).timestamp())
    assert situation.tick(after(2)) == [], "it is on its way"
    situation.report(after(40), docked=True, tilt=0.5)
    situation.answer(dock, "FINISHED")
    (tilt,) = situation.tick(after(40))
    assert (type(tilt), tilt.angle) == (m.Tilt, 0.28)
    situation.report(after(42), docked=True)
    assert situation.tick(after(42)) == []
    assert Robot.objects.get().presence.turnaround == "ready"
    assert SystemLog.objects.filter(event="robot_ready").count() == 1


STOPPED = m.Safety(inhibited="stopped")


def test_robot_that_is_stopped_while_it_returns_gets_no_order(giraff, ana, situation):
    end_session(giraff, ana)
    situation.report(after(1), docked=False)
    (dock,) = situation.tick(after(1))
    situation.answer(dock, "CANCELLED")
    for second in range(2, 400):
        situation.report(after(second), docked=False, safety=STOPPED)
        assert situation.tick(after(second)) == []
    presence = RobotPresence.objects.get()
    assert (presence.turnaround, presence.turnaround_reason) == ("paused", "stopped")
    assert SystemLog.objects.get(event="queue_paused").fields == {"reason": "stopped"}
    situation.report(after(400), docked=False)
    (again,) = situation.tick(after(400))
    assert isinstance(again, m.Dock)


def test_robot_that_was_stopped_between_sessions_may_be_taken(giraff, ana, ben, situation):
    robot = end_session(giraff, ana)
    situation.report(after(1), docked=False, safety=STOPPED)
    assert situation.tick(after(1)) == []
    assert store.pause_of(robot) == ""
    assert isinstance(store.take(Robot.objects.get(), ben, "p2", now=after(2)), store.TakeGranted)
    situation.report(after(3), docked=False, safety=STOPPED, session="s2")
    assert situation.tick(after(3)) == []
    assert Robot.objects.get().presence.turnaround == "ready"


def test_robot_that_was_stopped_between_sessions_is_offered_to_the_queue(
    giraff, ana, ben, situation
):
    robot = end_session(giraff, ana)
    assert isinstance(store.take(robot, ben, "p2", now=after(1)), store.Queued)
    situation.report(after(2), docked=False, safety=STOPPED)
    situation.tick(after(2))
    acts = tick(Robot.objects.get(), RobotLink(), after(3))
    assert [type(act) for act in acts] == [Offered]


def test_returning_robot_is_not_offered_and_the_queue_shows_the_reason(giraff, ana, ben, situation):
    robot = end_session(giraff, ana)
    queued = store.take(robot, ben, "p2", now=after(1))
    assert isinstance(queued, store.Queued)
    assert queued.reason == "returning: dock"
    assert queued.minutes > 0
    assert not any(isinstance(act, Offered) for act in tick(robot, RobotLink(), after(2)))
    situation.report(after(3), docked=True)
    situation.tick(after(3))
    acts = tick(Robot.objects.get(), RobotLink(), after(4))
    assert any(isinstance(act, Offered) for act in acts)


def test_offer_is_withdrawn_when_the_robot_is_no_longer_ready(giraff, ana):
    RobotPresence.objects.update(turnaround="ready")
    giraff.refresh_from_db()
    holder = store.take(giraff, User.objects.create(username="first"), "p0", now=NOW)
    store.take(giraff, ana, "p1", now=NOW)
    Robot.objects.update(returns_home=False)
    store.leave(holder.session, peer="p0", now=after(1))
    assert any(isinstance(act, Offered) for act in tick(giraff, RobotLink(), after(2)))
    update_robots(returns_home=True, turnaround="paused", turnaround_reason="estop")
    acts = tick(Robot.objects.get(), RobotLink(), after(3))
    assert any(isinstance(act, WithdrawOffer) for act in acts)


@pytest.fixture
def taken_while_returning(giraff, ana, ben, situation):
    """Return the order of a robot that an operator has taken while it returns."""
    robot = end_session(giraff, ana)
    situation.report(after(1), docked=False)
    (dock,) = situation.tick(after(1))
    RobotPermit.objects.create(robot=robot, user=ben, kind="operator")
    assert isinstance(store.take(Robot.objects.get(), ben, "p2", now=after(2)), store.TakeGranted)
    return dock


def test_operator_may_take_a_returning_robot_whose_order_is_cancelled(
    taken_while_returning, situation
):
    (cancel,) = situation.tick(after(3))
    assert (type(cancel), cancel.target) == (m.Cancel, taken_while_returning.action_id)
    assert Robot.objects.get().presence.turnaround == "ready"


def away(execute, sql, *args):
    """Refuse all writes: for `execute_wrapper`."""
    if sql.startswith(("UPDATE", "INSERT")):
        raise OperationalError
    return execute(sql, *args)


@pytest.mark.django_db(transaction=True)
def test_cancel_is_published_even_if_the_database_fails(taken_while_returning, situation):
    with connection.execute_wrapper(away), pytest.raises(OperationalError):
        situation.tick(after(3))
    (cancel,) = situation.tick(after(4))
    assert (type(cancel), cancel.target) == (m.Cancel, taken_while_returning.action_id)


@pytest.mark.django_db(transaction=True)
def test_order_that_could_not_be_stored_is_given_at_the_next_tick(giraff, ana, situation):
    end_session(giraff, ana)
    RobotPresence.objects.update(turnaround_reason="")
    situation.report(after(1), docked=False)
    with connection.execute_wrapper(away), pytest.raises(OperationalError):
        situation.tick(after(1))
    (dock,) = situation.tick(after(2))
    assert isinstance(dock, m.Dock)


def test_robot_that_cannot_return_pauses_the_queue_and_is_tried_again(giraff, ana, situation):
    reason = "the door is closed"
    end_session(giraff, ana)
    for second in range(1, 60):
        situation.report(after(second), docked=False)
        for action in situation.tick(after(second)):
            situation.answer(action, "FAILED", reason=reason)
    presence = RobotPresence.objects.get()
    assert (presence.turnaround, presence.turnaround_reason) == ("paused", reason)
    assert SystemLog.objects.get(event="queue_paused").fields["reason"] == reason
    situation.report(after(200), docked=False)
    assert [type(action) for action in situation.tick(after(200))] == [m.Dock]


def test_restarted_session_manager_goes_on_with_returning_robots(giraff, ana, situation):
    end_session(giraff, ana)
    situation.report(after(1), docked=False)
    assert situation.tick(after(1))
    situation.return_to_dock = ReturnToDock()
    assert [type(action) for action in situation.tick(after(2))] == [m.Dock]


@pytest.mark.parametrize(
    "change", [{"returns_home": False}, {"factsheet": {"capabilities": ["velocity"]}}]
)
def test_robot_that_need_not_or_cannot_return_is_free_at_once(giraff, ana, ben, change):
    update_robots(**change)
    giraff.refresh_from_db()
    robot = end_session(giraff, ana)
    assert robot.presence.turnaround == "ready"
    assert isinstance(store.take(robot, ben, "p2", now=after(1)), store.TakeGranted)


def test_takeover_of_a_live_session_does_not_send_the_robot_to_its_dock(giraff, ana, situation):
    granted = store.take(giraff, ana, "p1", now=NOW)
    again = store.take(
        giraff, ana, "p2", session=granted.session, old_peer="p1", takeover=True, now=after(1)
    )
    assert isinstance(again, store.TakeGranted)
    assert Robot.objects.get().presence.turnaround == "ready"


def test_robot_is_ready_only_after_its_camera_gave_a_picture(giraff, ana, situation):
    capabilities = [*FACTS["capabilities"], "photo"]
    RobotPresence.objects.update(factsheet=FACTS | {"capabilities": capabilities})
    end_session(giraff, ana)
    situation.report(after(1), docked=True, session="s1")
    assert situation.tick(after(1)) == [], "the picture would belong to the last driver's record"
    situation.report(after(2), docked=True)
    (photo,) = situation.tick(after(2))
    assert (type(photo), photo.role) == (m.Photo, "server")
    assert photo.action_id.startswith(ORDERED)
    assert store.pause_of(giraff) == "returning: picture"
    situation.report(after(3), docked=True)
    situation.answer(photo, "FINISHED")
    assert situation.tick(after(3)) == []
    assert Robot.objects.get().presence.turnaround == "ready"


def test_slow_network_of_the_robot_pauses_the_queue(giraff, ana, situation):
    end_session(giraff, ana)
    for second in (1, 2, 2 + NETWORK_PAUSE_S):
        situation.report(after(second), docked=True, trip=0.9)
        situation.tick(after(second))
    assert store.pause_of(giraff) == "paused: network"
    assert SystemLog.objects.get(event="queue_paused").fields["reason"] == "network"
    situation.report(after(40), docked=True, trip=0.1)
    situation.tick(after(40))
    assert Robot.objects.get().presence.turnaround == "ready"


def test_robot_that_answers_no_heartbeat_is_not_ready(giraff, ana, situation):
    end_session(giraff, ana)
    situation.liveness.take(words.state(1, tilt=0.28, docked=True), after(1).timestamp())
    situation.tick(after(1))
    assert store.pause_of(giraff) == "returning: network"
