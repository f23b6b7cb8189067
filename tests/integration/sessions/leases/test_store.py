"""Taking and giving up the robot, in the database."""

import functools
import random
from itertools import pairwise
from typing import Any

import pytest
from django.conf import settings
from django.db import connection
from django.test.utils import CaptureQueriesContext

from robots.api import topics
from robots.models import Robot, RobotPresence
from sessions.leases import store
from sessions.leases.expiry import tick
from sessions.leases.transitions import IDLE, ReleaseLease, RobotLink, SetState, decide_tick
from sessions.manager.scheduler import Scheduler
from sessions.models import Lease, Session, SessionEvent
from sessions.protocol import Ended, Offered
from tests.support.robots import online_robot, update_robots
from tests.support.sessions.rows import NOW, after

pytestmark = pytest.mark.django_db


def link(seconds: float, **fields: Any) -> RobotLink:
    """Return the link of a robot that sent a state at this time, and driver's data in fields."""
    at = after(seconds).timestamp()
    return RobotLink(since=NOW.timestamp(), last_received_at=at, state_at=at, **fields)


QUIET = RobotLink(since=NOW.timestamp(), last_received_at=NOW.timestamp())


@pytest.fixture(autouse=True)
def turns_of_fifteen_minutes(settings):
    settings.TURN_MINUTES = 15.0


@pytest.fixture
def giraff():
    return online_robot(max_linear=0.3)


def test_grant_contains_everything_that_page_and_robot_need(giraff, ana):
    granted = store.take(giraff, ana, "peer-1", device={"os": "Linux"}, now=NOW)
    assert (granted.epoch, granted.peer) == (1, "peer-1")
    assert (granted.resumed, granted.turn_seconds) == (False, None)
    lease = granted.lease
    assert (lease.who, lease.ttl, lease.limits.linear, lease.epoch) == ("Ana", 10.0, 0.3, 1)
    row = Session.objects.get(pk=granted.session)
    assert (row.state, row.granted_at, row.seen_at) == ("connecting", NOW, NOW)
    assert row.device == {"os": "Linux"}


def test_request_from_before_the_release_is_granted_as_of_the_release(giraff, ana, ben):
    """A database that answers late must not record two visitors at one time."""
    first = store.take(giraff, ana, "peer-1", now=NOW)
    store.leave(first.session, peer="peer-1", now=after(10.123456))
    second = store.take(giraff, ben, "peer-2", now=after(9))
    ended, granted = (Session.objects.get(pk=one.session) for one in (first, second))
    assert granted.granted_at == ended.ended_at == after(10.123456)


def test_page_resumes_with_its_lease_unchanged(giraff, ana):
    first = store.take(giraff, ana, "peer-1", now=NOW)
    Lease.objects.update(renewal=17)
    again = store.take(
        giraff, ana, "peer-2", session=first.session, old_peer="peer-1", now=after(1)
    )
    assert (again.resumed, again.epoch, again.peer, again.lease.renewal) == (True, 1, "peer-1", 17)


def test_reload_gets_a_new_epoch_in_the_same_session(giraff, ana):
    first = store.take(giraff, ana, "peer-1", now=NOW)
    Session.objects.update(state="driving", driving_at=NOW)
    store.page_closed(first.session, "peer-1", after(1))
    again = store.take(giraff, ana, "peer-2", session=first.session, now=after(2))
    assert (again.session, again.epoch, again.resumed) == (first.session, 2, False)
    assert Session.objects.get().state == "reconnecting"
    assert Session.objects.get().granted_at == NOW


def test_old_page_of_a_moved_session_can_neither_end_nor_lose_it(giraff, ana):
    first = store.take(giraff, ana, "peer-1", now=NOW)
    store.take(giraff, ana, "peer-2", takeover=True, now=after(1))
    assert not store.leave(first.session, peer="peer-1", now=after(2))
    store.page_closed(first.session, "peer-1", after(2))
    row = Session.objects.get()
    assert (row.state, row.seen_at) == ("connecting", after(1))


def test_leaving_completes_a_drive_and_frees_the_robot(giraff, ana, ben):
    granted = store.take(giraff, ana, "peer-1", now=NOW)
    Session.objects.update(first_motion_at=after(1))
    assert store.leave(granted.session, peer="peer-1", now=after(9))
    row = Session.objects.get()
    assert (row.state, row.outcome, row.outcome_reason) == ("ended", "completed", "left")
    assert (row.ended_at, row.live_key) == (after(9), granted.session)
    assert Lease.objects.get().session is None
    assert not store.leave(granted.session, peer="peer-1", now=after(10))
    assert store.take(giraff, ben, "peer-3", now=after(10)).epoch == 3


def test_leaving_the_queue_does_not_change_the_lease(giraff, ana, ben):
    store.take(giraff, ana, "peer-1", now=NOW)
    queued = store.take(giraff, ben, "peer-2", now=NOW)
    assert (queued.place, queued.minutes) == (1, 15.0)
    assert store.leave(queued.session, peer="peer-2", now=after(1))
    assert Session.objects.get(visitor=ben).outcome == "cancelled"
    assert Lease.objects.get().session.visitor == ana


def test_visitor_can_drive_again_after_a_session_has_ended(giraff, ana):
    first = store.take(giraff, ana, "peer-1", now=NOW)
    store.leave(first.session, peer="peer-1", now=after(1))
    second = store.take(giraff, ana, "peer-1", now=after(2))
    assert isinstance(second, store.TakeGranted)
    assert second.session != first.session


def test_waiting_page_that_reconnects_is_no_longer_lost(giraff, ana, ben):
    store.take(giraff, ana, "peer-1", now=NOW)
    queued = store.take(giraff, ben, "peer-2", now=NOW)
    store.page_closed(queued.session, "peer-2", after(1))
    assert Session.objects.get(visitor=ben).lost_at == after(1)
    assert store.seen({queued.session}, after(2)) == {queued.session}
    assert Session.objects.get(visitor=ben).lost_at is None
    store.leave(queued.session, peer="peer-2", now=after(3))
    assert store.seen({queued.session}, after(4)) == set()


def test_open_pages_are_recorded_as_seen_with_two_queries(
    giraff, ana, ben, django_assert_num_queries
):
    over = store.take(giraff, ana, "peer-1", now=NOW)
    store.leave(over.session, peer="peer-1", now=after(1))
    first = store.take(giraff, ana, "peer-1", now=after(2))
    queued = store.take(giraff, ben, "peer-2", now=after(2))
    live = {first.session, queued.session}
    with django_assert_num_queries(2):
        assert store.seen({over.session, *live}, after(9)) == live
    assert {str(row.pk) for row in Session.objects.filter(seen_at=after(9))} == live


def test_grant_limits_the_turn_when_others_wait(giraff, ana, ben):
    first = store.take(giraff, ana, "peer-1", now=NOW)
    store.take(giraff, ben, "peer-2", now=NOW)
    again = store.take(giraff, ana, "peer-1", session=first.session, now=after(60))
    assert again.turn_seconds == pytest.approx(14 * 60)


def test_session_ends_only_once(giraff, ana):
    granted = store.take(giraff, ana, "peer-1", now=NOW)
    end = functools.partial(store.end, granted.session, "stopped_by_operator", "x")
    assert end(after(0))
    assert not end(after(1))
    assert Session.objects.get().ended_at == after(0)


def test_visitor_who_returned_is_not_ended_by_an_older_decision(giraff, ana, monkeypatch):
    """The visitor returns between the session manager's decision, that the grace is over, and its
    act.
    """
    granted = store.take(giraff, ana, "peer-1", now=NOW)
    Session.objects.update(state="reconnecting", lost_at=NOW)
    load = store.load_scene

    def then_the_visitor_returns(robot, now):
        scene = load(robot, now)
        monkeypatch.setattr("sessions.leases.expiry.load_scene", load)
        again = store.take(robot, ana, "peer-2", session=granted.session, now=after(100))
        assert isinstance(again, store.TakeGranted)
        return scene

    monkeypatch.setattr("sessions.leases.expiry.load_scene", then_the_visitor_returns)
    assert tick(giraff, link(100), after(100)) == ()
    assert Session.objects.get().state == "reconnecting"


def test_tick_makes_as_many_queries_for_many_driven_robots_as_for_one(ana, ben, monkeypatch):
    """A tick is made twice a second, on a computer that does other work too."""
    # no early renewal
    monkeypatch.setattr("sessions.manager.scheduler.random.random", lambda: 0.0)

    def queries(robots: int) -> int:
        for number in range(Robot.objects.count(), robots):
            granted = store.take(online_robot(f"r{number}"), ana, f"peer-{number}", now=NOW)
            assert isinstance(granted, store.TakeGranted)
        Session.objects.update(state="driving", driving_at=NOW, first_motion_at=NOW, seen_at=NOW)
        links = {
            robot.name: link(1, session=str(robot.lease.session_id), epoch=1, silence=0.1)
            for robot in Robot.objects.all()
        }
        keeper = Scheduler()
        keeper.tick(links, RobotLink(since=NOW.timestamp()), after(0.5))
        keeper.renew(after(0.5))
        with CaptureQueriesContext(connection) as executed:
            keeper.tick(links, RobotLink(since=NOW.timestamp()), after(1))
            assert not keeper.renew(after(1)), "nothing is due"
        assert all(query["sql"].startswith("SELECT") for query in executed)
        return len(executed)

    few = queries(1)
    assert queries(12) == few <= 10


def test_activity_during_the_decision_to_end_keeps_the_robot(giraff, ana, monkeypatch, settings):
    settings.IDLE_SECONDS = 60.0
    granted = store.take(giraff, ana, "peer-1", now=NOW)
    Session.objects.update(state="driving", driving_at=NOW, seen_at=after(100))
    signs, asked = {}, (granted.session, after(61).timestamp())
    driving = {"session": granted.session, "epoch": 1, "silence": 0.1}
    idle = link(100, **driving, asked=asked, signs=signs)

    def then_the_sign_comes(*known):
        acts = decide_tick(*known)
        signs[granted.session] = after(100.1).timestamp()
        return acts

    with monkeypatch.context() as patched:
        patched.setattr("sessions.leases.expiry.decide_tick", then_the_sign_comes)
        assert tick(giraff, idle, after(100)) == ()
    assert Session.objects.get().state == "driving"
    signs.clear()
    ended = Ended(session=granted.session, outcome="timed_out", reason=IDLE)
    assert tick(giraff, idle, after(100)) == (ended,)


def test_tick_repairs_what_a_process_left_between_lease_and_session(giraff, ana, ben):
    granted = store.take(giraff, ana, "peer-1", now=NOW)
    Session.objects.update(state="waiting")
    assert tick(giraff, QUIET, after(1)) == (SetState(granted.session, "connecting"),)
    # and its end, without the lease
    Session.objects.update(state="ended", live_key="x", outcome="cancelled")
    assert tick(giraff, QUIET, after(2)) == (ReleaseLease(1),)
    assert isinstance(store.take(giraff, ben, "peer-2", now=after(3)), store.TakeGranted)


def test_leases_granted_together_are_renewed_at_different_times(ana, monkeypatch):
    monkeypatch.setattr("sessions.manager.scheduler.random.random", random.Random(1).random)
    robots = [online_robot(f"r{number}") for number in range(12)]
    for robot in robots:
        assert isinstance(store.take(robot, ana, f"peer-{robot.name}", now=NOW), store.TakeGranted)
    Session.objects.update(state="driving", driving_at=NOW, first_motion_at=NOW, seen_at=NOW)
    keeper, moments = Scheduler(), {robot.name: [] for robot in robots}
    for look in range(21):
        seconds = look * 0.5
        while keeper.renew(after(seconds)):
            for outbound in keeper.outbox:
                robot, suffix = topics.parse(outbound.topic)
                assert suffix == "lease"
                moments[robot].append(seconds)
            keeper.outbox.clear()
    for renewed in moments.values():
        assert renewed[0] == 0.0
        gaps = [later - at for at, later in pairwise(renewed)]
        assert all(0.0 < gap <= settings.LEASE_RENEWAL_SECONDS for gap in gaps)
    assert len(set(map(tuple, moments.values()))) > 1, "all are always renewed together"


def test_empty_lease_is_published_before_the_notice_of_the_end(giraff, ana):
    granted = store.take(giraff, ana, "peer-1", now=NOW)
    Session.objects.update(state="driving", driving_at=NOW)
    keeper = Scheduler()
    assert keeper.renew(after(0.5))
    keeper.outbox.clear()
    store.end(granted.session, Session.Outcome.STOPPED_BY_OPERATOR, "", after(0.9))
    keeper.tick({}, RobotLink(since=NOW.timestamp()), after(1))
    assert keeper.renew(after(1))
    first, *others = keeper.outbox
    assert (first.topic, first.payload, first.retain) == (topics.of("giraff", "lease"), b"", True)
    assert topics.session_notices(granted.session) in [outbound.topic for outbound in others]


def test_turn_is_limited_only_while_others_wait(giraff, ana, ben):
    granted = store.take(giraff, ana, "peer-1", now=NOW)
    Session.objects.update(state="driving", driving_at=NOW, first_motion_at=NOW)
    keeper = Scheduler()

    def turn_ends_at(seconds):
        driving = {"session": granted.session, "epoch": granted.epoch, "silence": 0.1}
        moving = link(seconds, **driving, moved=True, active_at=after(seconds).timestamp())
        keeper.tick({"giraff": moving}, RobotLink(since=NOW.timestamp()), after(seconds))
        return Session.objects.get(pk=granted.session).turn_ends_at

    assert turn_ends_at(1) is None
    waiting = store.take(giraff, ben, "peer-2", now=after(2))
    assert turn_ends_at(3) == after(900)
    store.leave(waiting.session, peer="peer-2", now=after(4))
    assert turn_ends_at(5) is None
    noted = SessionEvent.objects.filter(session=granted.session, type__startswith="turn_")
    assert set(noted.values_list("type", flat=True)) == {"turn_limited", "turn_unlimited"}


def test_grant_during_the_read_of_the_scene_is_not_released(giraff, ana, monkeypatch):
    objects = Session.objects.filter
    began = []

    class Read(list):
        def defer(self, *_):
            return self

    def filter_then_grant(*args, **kwargs):
        rows = objects(*args, **kwargs)
        if giraff.pk in kwargs.get("robot__in", ()) and not began:
            found = Read(rows)
            began.append(True)
            store.take(giraff, ana, "peer-1", now=NOW)
            return found
        return rows

    monkeypatch.setattr(Session.objects, "filter", filter_then_grant)
    assert tick(giraff, QUIET, NOW) == ()
    assert Lease.objects.get().session.visitor == ana


def test_queue_is_offered_the_robot_in_order(giraff, ana, ben):
    first = store.take(giraff, ana, "peer-1", now=NOW)
    queued = store.take(giraff, ben, "peer-2", now=NOW)
    store.leave(first.session, peer="peer-1", now=after(1))
    offered = Offered(session=queued.session, seconds=settings.START_SECONDS)
    assert tick(giraff, QUIET, after(1)) == (offered,)
    assert isinstance(store.take(giraff, ana, "peer-1", now=after(2)), store.Queued)
    store.seen({queued.session}, after(70))
    ended = Ended(session=queued.session, outcome="cancelled", reason="turn_not_taken")
    assert ended in tick(giraff, QUIET, after(70))


STOPPED = {"safety": {"estop": True, "estopSource": "screen:Giraff"}}
FAULTY = {"safety": {"inhibited": "fault"}}
LOST = {"safety": {"inhibited": "fault"}, "errors": ["adapter_lost: no answer"]}

RUNS_ON = {"safety": {"inhibited": "no_lease"}, "errors": ["runs_on: the robot keeps moving"]}


@pytest.mark.parametrize(
    ("report", "reason"),
    [(STOPPED, "estop"), (FAULTY, "fault"), (LOST, "not_connected"), (RUNS_ON, "fault")],
)
def test_robot_that_cannot_drive_is_not_offered_and_places_are_kept(
    giraff, ana, ben, report, reason
):
    RobotPresence.objects.update(report=report)
    giraff.refresh_from_db()
    first = store.take(giraff, ana, "peer-1", now=NOW)
    second = store.take(giraff, ben, "peer-2", now=after(1))
    assert [queued.place for queued in (first, second)] == [1, 2]
    assert {queued.reason for queued in (first, second)} == {f"paused: {reason}"}
    assert tick(giraff, RobotLink(), after(2)) == ()
    RobotPresence.objects.update(report={"safety": {"estop": False, "inhibited": "no_lease"}})
    assert [act.session for act in tick(giraff, RobotLink(), after(3))] == [first.session]
    RobotPresence.objects.update(report=report)  # before the turn was taken
    tick(giraff, RobotLink(), after(4))
    again = store.take(giraff, ana, "peer-1", session=first.session, now=after(5))
    assert (again.place, again.reason) == (1, f"paused: {reason}")


@pytest.mark.parametrize("report", [STOPPED, RUNS_ON])
def test_driver_keeps_a_robot_that_cannot_drive_even_after_a_reload(giraff, ana, report):
    granted = store.take(giraff, ana, "peer-1", now=NOW)
    RobotPresence.objects.update(report=report)
    assert tick(giraff, QUIET, after(1)) == ()
    back = store.take(
        giraff, ana, "peer-2", session=granted.session, old_peer="peer-1", now=after(1)
    )
    assert isinstance(back, store.TakeGranted)


def test_operator_may_take_a_stopped_robot_to_release_it(giraff, ana, ben):
    update_robots(report=STOPPED, owner=ben)
    giraff.refresh_from_db()
    store.take(giraff, ana, "peer-1", now=NOW)
    assert isinstance(store.take(giraff, ben, "peer-2", now=after(1)), store.TakeGranted)


# --- another process acts in between --------------------------------------------------------------


def after_first_call(monkeypatch, name, happens):
    """Call `happens` just after the first call of a function of the store."""
    original, pending = getattr(store, name), [happens]

    def call(*values, **words):
        found = original(*values, **words)
        if pending:
            pending.pop()()
        return found

    monkeypatch.setattr(store, name, call)


def test_two_tabs_that_take_a_free_robot_at_once_get_one_session(giraff, ana, monkeypatch):
    first = []
    after_first_call(
        monkeypatch,
        "load_scene",
        lambda: first.append(store.take(giraff, ana, "peer-1", now=NOW)),
    )
    second = store.take(giraff, ana, "peer-2", now=NOW)
    assert (second.reason, second.session) == ("elsewhere", first[0].session)
    assert second.since is not None
    assert Session.objects.count() == 1


def test_two_tabs_that_queue_at_once_have_one_place(giraff, ana, ben, monkeypatch):
    store.take(giraff, ana, "peer-1", now=NOW)
    first = []
    after_first_call(
        monkeypatch, "load_scene", lambda: first.append(store.take(giraff, ben, "peer-2", now=NOW))
    )
    second = store.take(giraff, ben, "peer-3", now=NOW)
    assert (first[0].place, second.place, second.session) == (1, 1, first[0].session)
    assert Session.objects.filter(visitor=ben).count() == 1


def test_one_of_two_simultaneous_visitors_drives_and_the_other_waits(giraff, ana, ben, monkeypatch):
    after_first_call(monkeypatch, "load_scene", lambda: store.take(giraff, ana, "peer-1", now=NOW))
    taken = store.take(giraff, ben, "peer-2", now=NOW)
    assert isinstance(taken, store.Queued)
    assert Lease.objects.get().peer == "peer-1"


def test_visitor_who_leaves_in_another_tab_during_a_grant_gets_a_new_session(
    giraff, ana, monkeypatch
):
    left = []

    def leave():
        left.append(Session.objects.get().pk)
        Session.objects.update(state="ended", outcome="cancelled", live_key=str(left[0]))

    after_first_call(monkeypatch, "fix_terms", leave)
    granted = store.take(giraff, ana, "peer-1", now=NOW)
    assert granted.session != str(left[0])
    assert str(Lease.objects.get().session_id) == granted.session


def test_take_fails_if_the_lease_changes_during_each_attempt(giraff, ana, monkeypatch):
    monkeypatch.setattr(store, "ATTEMPTS", 3)
    monkeypatch.setattr(store, "change_lease", lambda *_, **__: False)
    with pytest.raises(store.LeaseContention, match="giraff"):
        store.take(giraff, ana, "peer-1", now=NOW)
    assert Lease.objects.get().session is None


def test_page_that_no_longer_drives_cannot_choose_the_assistance(giraff, ana):
    first = store.take(giraff, ana, "peer-1", now=NOW)
    assert store.set_assist(first.session, "slow", peer="peer-2") is None
    lease = store.set_assist(first.session, "slow", peer="peer-1")
    assert (str(lease.session_id), lease.renewal) == (first.session, 1)
    Session.objects.update(state="ended")
    assert store.set_assist(first.session, "steer", peer="peer-1") is None
    assert Session.objects.get().assist == "slow"
