"""Robots that return to their dock between two sessions: their orders, who may drive them, and what
the database has.
"""

import datetime
from collections import deque

import pytest
from django.db import OperationalError, connection
from django.utils import timezone

from accounts.models import User
from robots.api import codec
from robots.api import messages as m
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
from tests.support.robots import create_robot, update_robots

pytestmark = pytest.mark.django_db
NOW = timezone.now()
FACTS = {
    "series": "giraff",
    "capabilities": ["velocity", "dock", "tilt"],
    "tilt": {"minimum": -0.5, "maximum": 0.9, "home": 0.28, "speed": 0.8},
}


def after(seconds: float) -> datetime.datetime:
    return NOW + datetime.timedelta(seconds=seconds)


@pytest.fixture
def giraff():
    return create_robot(
        name="giraff",
        title="Giraff",
        connection="ONLINE",
        last_seen_at=after(1000),
        factsheet=FACTS,
    )


class Situation:
    """The robot as the session manager hears it."""

    def __init__(self):
        self.return_to_dock, self.liveness, self.seq = ReturnToDock(), RobotLiveness(), 0
        self.outbox = deque()

    def says(self, now, *, trip=0.05, **changes):
        """A state, and an answer to the server's beat that was under way for so many seconds."""
        self.seq += 1
        self.liveness.take(words.state(self.seq, **{"tilt": 0.28, **changes}), now.timestamp())
        sent = now.timestamp() - trip
        echo = m.Echo(peer="server", n=self.seq, stamp=sent, received=sent + trip / 2)
        self.liveness.heartbeat(
            m.Heartbeat(n=self.seq, stamp=sent + trip / 2, echoes=(echo,)),
            now.timestamp(),
            now.timestamp(),
        )

    def look(self, now):
        liveness = {"giraff": self.liveness}
        self.outbox.extend(self.return_to_dock.tick(liveness, now, now.timestamp()))
        published = [codec.decode("command/action", one.payload, "to_robot") for one in self.outbox]
        self.outbox.clear()
        return published


@pytest.fixture
def situation():
    return Situation()


def a_session_ends(robot, visitor, now=NOW):
    granted = store.take(robot, visitor, "p1", now=now)
    assert store.leave(granted.session, peer="p1", now=now)
    return Robot.objects.get(pk=robot.pk)


def test_a_robot_that_was_left_somewhere_is_sent_home_by_the_server(giraff, ana, situation):
    a_session_ends(giraff, ana)
    situation.says(after(1), docked=False)
    (dock,) = situation.look(after(1))
    assert isinstance(dock, m.Dock)
    assert (dock.role, dock.session, dock.stamp) == ("server", None, after(1).timestamp())
    assert situation.look(after(2)) == [], "it is on its way"
    situation.says(after(40), docked=True, tilt=0.5)
    situation.liveness.answer(
        m.ActionStatus(action_id=dock.action_id, status="FINISHED", stamp=1.0)
    )
    (tilt,) = situation.look(after(40))
    assert (type(tilt), tilt.angle) == (m.Tilt, 0.28)
    situation.says(after(42), docked=True)
    assert situation.look(after(42)) == []
    assert Robot.objects.get().presence.turnaround == "ready"
    assert SystemLog.objects.filter(event="robot_ready").count() == 1


STOPPED = m.Safety(inhibited="stopped")


def test_a_robot_that_is_stopped_on_its_way_is_ordered_nothing(giraff, ana, situation):
    a_session_ends(giraff, ana)
    situation.says(after(1), docked=False)
    (dock,) = situation.look(after(1))
    cancelled = m.ActionStatus(action_id=dock.action_id, status="CANCELLED", stamp=1.0)
    situation.liveness.answer(cancelled)
    for second in range(2, 400):
        situation.says(after(second), docked=False, safety=STOPPED)
        assert situation.look(after(second)) == []
    presence = RobotPresence.objects.get()
    assert (presence.turnaround, presence.turnaround_reason) == ("paused", "stopped")
    assert SystemLog.objects.get(event="queue_paused").fields == {"reason": "stopped"}
    situation.says(after(400), docked=False)
    (again,) = situation.look(after(400))
    assert isinstance(again, m.Dock)


def test_a_robot_that_was_stopped_between_visits_is_given_to_a_new_driver(
    giraff, ana, ben, situation
):
    robot = a_session_ends(giraff, ana)
    situation.says(after(1), docked=False, safety=STOPPED)
    assert situation.look(after(1)) == []
    assert store.pause_of(robot) == ""
    assert isinstance(store.take(Robot.objects.get(), ben, "p2", now=after(2)), store.TakeGranted)
    situation.says(after(3), docked=False, safety=STOPPED, session="s2")
    assert situation.look(after(3)) == []
    assert Robot.objects.get().presence.turnaround == "ready"


def test_the_queue_of_a_robot_that_was_stopped_between_visits_goes_on(giraff, ana, ben, situation):
    robot = a_session_ends(giraff, ana)
    assert isinstance(store.take(robot, ben, "p2", now=after(1)), store.Queued)
    situation.says(after(2), docked=False, safety=STOPPED)
    situation.look(after(2))
    acts = tick(Robot.objects.get(), RobotLink(), after(3))
    assert [type(act) for act in acts] == [Offered]


def test_a_returning_robot_is_given_to_none_and_waiting_visitors_learn_why(
    giraff, ana, ben, situation
):
    robot = a_session_ends(giraff, ana)
    queued = store.take(robot, ben, "p2", now=after(1))
    assert isinstance(queued, store.Queued)
    assert queued.reason == "returning: dock"
    assert queued.minutes > 0
    assert not [act for act in tick(robot, RobotLink(), after(2)) if isinstance(act, Offered)]
    situation.says(after(3), docked=True)
    situation.look(after(3))
    assert [
        act for act in tick(Robot.objects.get(), RobotLink(), after(4)) if isinstance(act, Offered)
    ]


def test_an_offer_is_taken_back_when_the_robot_is_not_ready_after_all(giraff, ana):
    RobotPresence.objects.update(turnaround="ready")
    giraff.refresh_from_db()
    holder = store.take(giraff, User.objects.create(username="first"), "p0", now=NOW)
    store.take(giraff, ana, "p1", now=NOW)
    Robot.objects.update(returns_home=False)
    store.leave(holder.session, peer="p0", now=after(1))
    assert any(isinstance(act, Offered) for act in tick(giraff, RobotLink(), after(2)))
    update_robots(returns_home=True, turnaround="paused", turnaround_reason="estop")
    assert any(
        isinstance(act, WithdrawOffer) for act in tick(Robot.objects.get(), RobotLink(), after(3))
    )


@pytest.fixture
def taken_while_returning(giraff, ana, ben, situation):
    """What a robot was ordered that an operator has taken while it goes home."""
    robot = a_session_ends(giraff, ana)
    situation.says(after(1), docked=False)
    (dock,) = situation.look(after(1))
    RobotPermit.objects.create(robot=robot, user=ben, kind="operator")
    assert isinstance(store.take(Robot.objects.get(), ben, "p2", now=after(2)), store.TakeGranted)
    return dock


def test_an_operator_may_take_a_robot_that_is_stuck_and_what_was_ordered_is_taken_back(
    taken_while_returning, situation
):
    (cancel,) = situation.look(after(3))
    assert (type(cancel), cancel.target) == (m.Cancel, taken_while_returning.action_id)
    assert Robot.objects.get().presence.turnaround == "ready"


def away(execute, sql, *args):
    """Refuse all writes, as a database that is away: for `execute_wrapper`."""
    if sql.startswith(("UPDATE", "INSERT")):
        raise OperationalError
    return execute(sql, *args)


@pytest.mark.django_db(transaction=True)
def test_a_cancelled_order_is_published_even_if_the_database_fails(
    taken_while_returning, situation
):
    with connection.execute_wrapper(away), pytest.raises(OperationalError):
        situation.look(after(3))
    (cancel,) = situation.look(after(4))
    assert (type(cancel), cancel.target) == (m.Cancel, taken_while_returning.action_id)


@pytest.mark.django_db(transaction=True)
def test_an_order_that_the_database_refused_is_given_at_the_next_look(giraff, ana, situation):
    a_session_ends(giraff, ana)
    RobotPresence.objects.update(turnaround_reason="")
    situation.says(after(1), docked=False)
    with connection.execute_wrapper(away), pytest.raises(OperationalError):
        situation.look(after(1))
    (dock,) = situation.look(after(2))
    assert isinstance(dock, m.Dock)


def test_a_robot_that_cannot_get_home_pauses_the_queue_and_says_why_and_is_tried_again(
    giraff, ana, situation
):
    a_session_ends(giraff, ana)
    for second in range(1, 60):
        situation.says(after(second), docked=False)
        for action in situation.look(after(second)):
            situation.liveness.answer(
                m.ActionStatus(
                    action_id=action.action_id,
                    status="FAILED",
                    stamp=1.0,
                    reason="the door is closed",
                )
            )
    robot = Robot.objects.get()
    assert (robot.presence.turnaround, robot.presence.turnaround_reason) == (
        "paused",
        "the door is closed",
    )
    assert SystemLog.objects.get(event="queue_paused").fields["reason"] == "the door is closed"
    situation.says(after(200), docked=False)
    assert [type(action) for action in situation.look(after(200))] == [m.Dock]


def test_a_session_manager_that_starts_anew_goes_on_with_robots_under_way(giraff, ana, situation):
    a_session_ends(giraff, ana)
    situation.says(after(1), docked=False)
    assert situation.look(after(1))
    situation.return_to_dock = ReturnToDock()
    assert [type(action) for action in situation.look(after(2))] == [m.Dock]


@pytest.mark.parametrize(
    "change", [{"returns_home": False}, {"factsheet": {"capabilities": ["velocity"]}}]
)
def test_a_robot_that_need_not_or_cannot_go_home_is_free_at_once(giraff, ana, ben, change):
    update_robots(**change)
    giraff.refresh_from_db()
    robot = a_session_ends(giraff, ana)
    assert robot.presence.turnaround == "ready"
    assert isinstance(store.take(robot, ben, "p2", now=after(1)), store.TakeGranted)


def test_the_same_page_that_comes_back_to_a_living_visit_does_not_send_the_robot_home(
    giraff, ana, situation
):
    granted = store.take(giraff, ana, "p1", now=NOW)
    again = store.take(
        giraff, ana, "p2", session=granted.session, old_peer="p1", takeover=True, now=after(1)
    )
    assert isinstance(again, store.TakeGranted)
    assert Robot.objects.get().presence.turnaround == "ready"


def test_a_robot_is_ready_only_after_its_camera_gave_a_picture(giraff, ana, situation):
    RobotPresence.objects.update(
        factsheet={**FACTS, "capabilities": ["velocity", "dock", "tilt", "photo"]}
    )
    a_session_ends(giraff, ana)
    situation.says(after(1), docked=True, session="s1")
    assert situation.look(after(1)) == [], (
        "it still has its last driver, whose record the picture would be in"
    )
    situation.says(after(2), docked=True)
    (photo,) = situation.look(after(2))
    assert (type(photo), photo.role, photo.action_id[: len(ORDERED)]) == (
        m.Photo,
        "server",
        ORDERED,
    )
    assert store.pause_of(giraff) == "returning: picture"
    situation.says(after(3), docked=True)
    situation.liveness.answer(
        m.ActionStatus(action_id=photo.action_id, status="FINISHED", stamp=1.0)
    )
    assert situation.look(after(3)) == []
    assert Robot.objects.get().presence.turnaround == "ready"


def test_a_robot_that_answers_too_late_pauses_the_queue_until_its_network_is_better(
    giraff, ana, situation
):
    a_session_ends(giraff, ana)
    for second in (1, 2, 2 + NETWORK_PAUSE_S):
        situation.says(after(second), docked=True, trip=0.9)
        situation.look(after(second))
    assert store.pause_of(giraff) == "paused: network"
    assert SystemLog.objects.get(event="queue_paused").fields["reason"] == "network"
    situation.says(after(40), docked=True, trip=0.1)
    situation.look(after(40))
    assert Robot.objects.get().presence.turnaround == "ready"


def test_a_robot_that_answers_no_beat_is_not_ready(giraff, ana, situation):
    a_session_ends(giraff, ana)
    situation.liveness.take(words.state(1, tilt=0.28, docked=True), after(1).timestamp())
    situation.look(after(1))
    assert store.pause_of(giraff) == "returning: network"
