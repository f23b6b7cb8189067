"""Taking and giving up the robot, in the database."""

import datetime
import random
from itertools import pairwise

import pytest
from django.conf import settings
from django.db import connection
from django.test.utils import CaptureQueriesContext
from django.utils import timezone

from accounts.models import User
from robots.api import topics
from robots.models import Robot, RobotPresence
from sessions.leases import store
from sessions.leases.expiry import tick
from sessions.leases.transitions import IDLE, ReleaseLease, RobotLink, SetState, decide_tick
from sessions.manager.scheduler import Scheduler
from sessions.models import Lease, Session, SessionEvent
from sessions.protocol import Ended, Offered
from tests.support.robots import create_robot, update_robots

pytestmark = pytest.mark.django_db
NOW = timezone.now()


def after(seconds: float) -> datetime.datetime:
    return NOW + datetime.timedelta(seconds=seconds)


@pytest.fixture(autouse=True)
def turns_of_fifteen_minutes(settings):
    settings.TURN_MINUTES = 15.0


@pytest.fixture
def giraff():
    return create_robot(
        name="giraff", title="Giraff", connection="ONLINE", last_seen_at=after(1000), max_linear=0.3
    )


def test_a_grant_names_everything_that_page_and_robot_need(giraff, ana):
    granted = store.take(giraff, ana, "peer-1", device={"os": "Linux"}, now=NOW)
    assert (granted.epoch, granted.peer, granted.resumed, granted.turn_seconds) == (
        1,
        "peer-1",
        False,
        None,
    )
    assert (
        granted.lease.who,
        granted.lease.ttl,
        granted.lease.limits.linear,
        granted.lease.epoch,
    ) == ("Ana", 10.0, 0.3, 1)
    row = Session.objects.get(pk=granted.session)
    assert (row.state, row.granted_at, row.seen_at, row.device) == (
        "connecting",
        NOW,
        NOW,
        {"os": "Linux"},
    )


def test_a_request_from_before_the_release_is_granted_as_of_the_release(giraff, ana, ben):
    """A database that answers late must not make the record say that two had it."""
    first = store.take(giraff, ana, "peer-1", now=NOW)
    store.leave(first.session, peer="peer-1", now=after(10.123456))
    second = store.take(giraff, ben, "peer-2", now=after(9))
    ended, granted = (Session.objects.get(pk=one.session) for one in (first, second))
    assert granted.granted_at == ended.ended_at == after(10.123456)


def test_the_same_page_resumes_with_the_lease_as_it_is(giraff, ana):
    first = store.take(giraff, ana, "peer-1", now=NOW)
    Lease.objects.update(renewal=17)
    again = store.take(
        giraff, ana, "peer-2", session=first.session, old_peer="peer-1", now=after(1)
    )
    assert (again.resumed, again.epoch, again.peer, again.lease.renewal) == (True, 1, "peer-1", 17)


def test_a_reload_gets_a_new_epoch_in_the_same_session(giraff, ana):
    first = store.take(giraff, ana, "peer-1", now=NOW)
    Session.objects.update(state="driving", driving_at=NOW)
    store.page_closed(first.session, "peer-1", after(1))
    again = store.take(giraff, ana, "peer-2", session=first.session, now=after(2))
    assert (again.session, again.epoch, again.resumed) == (first.session, 2, False)
    assert Session.objects.get().state == "reconnecting"
    assert Session.objects.get().granted_at == NOW


def test_the_old_page_of_a_session_that_moved_can_neither_end_nor_lose_it(giraff, ana):
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
    assert (row.state, row.outcome, row.outcome_reason, row.ended_at, row.live_key) == (
        "ended",
        "completed",
        "left",
        after(9),
        granted.session,
    )
    assert Lease.objects.get().session is None
    assert not store.leave(granted.session, peer="peer-1", now=after(10))
    assert store.take(giraff, ben, "peer-3", now=after(10)).epoch == 3


def test_leaving_the_queue_is_cancelled_and_touches_nobodys_lease(giraff, ana, ben):
    store.take(giraff, ana, "peer-1", now=NOW)
    queued = store.take(giraff, ben, "peer-2", now=NOW)
    assert (queued.place, queued.minutes) == (1, 15.0)
    assert store.leave(queued.session, peer="peer-2", now=after(1))
    assert Session.objects.get(visitor=ben).outcome == "cancelled"
    assert Lease.objects.get().session.visitor == ana


def test_a_visitor_can_drive_again_after_a_session_has_ended(giraff, ana):
    first = store.take(giraff, ana, "peer-1", now=NOW)
    store.leave(first.session, peer="peer-1", now=after(1))
    second = store.take(giraff, ana, "peer-1", now=after(2))
    assert isinstance(second, store.TakeGranted)
    assert second.session != first.session


def test_a_page_that_waits_and_is_back_is_not_lost(giraff, ana, ben):
    store.take(giraff, ana, "peer-1", now=NOW)
    queued = store.take(giraff, ben, "peer-2", now=NOW)
    store.page_closed(queued.session, "peer-2", after(1))
    assert Session.objects.get(visitor=ben).lost_at == after(1)
    assert store.seen({queued.session}, after(2)) == {queued.session}
    assert Session.objects.get(visitor=ben).lost_at is None
    store.leave(queued.session, peer="peer-2", now=after(3))
    assert store.seen({queued.session}, after(4)) == set()


def test_many_pages_are_seen_with_two_questions_and_those_that_are_over_are_left_alone(
    giraff, ana, ben, django_assert_num_queries
):
    over = store.take(giraff, ana, "peer-1", now=NOW)
    store.leave(over.session, peer="peer-1", now=after(1))
    first, queued = (
        store.take(giraff, ana, "peer-1", now=after(2)),
        store.take(giraff, ben, "peer-2", now=after(2)),
    )
    with django_assert_num_queries(2):
        assert store.seen({over.session, first.session, queued.session}, after(9)) == {
            first.session,
            queued.session,
        }
    assert {str(row.pk): row.seen_at == after(9) for row in Session.objects.all()} == {
        over.session: False,
        first.session: True,
        queued.session: True,
    }


def test_the_turn_is_limited_in_the_grant_when_others_wait(giraff, ana, ben):
    first = store.take(giraff, ana, "peer-1", now=NOW)
    store.take(giraff, ben, "peer-2", now=NOW)
    again = store.take(giraff, ana, "peer-1", session=first.session, now=after(60))
    assert again.turn_seconds == pytest.approx(14 * 60)


def test_an_offline_robot_is_refused_by_its_row(giraff, ana):
    giraff.presence.connection = "OFFLINE"
    assert store.take(giraff, ana, "peer-1", now=NOW) == store.Refused(reason="offline")
    assert not Session.objects.exists()


def test_ending_twice_happens_once(giraff, ana):
    granted = store.take(giraff, ana, "peer-1", now=NOW)
    assert [store.end(granted.session, "stopped_by_operator", "x", after(n)) for n in range(2)] == [
        True,
        False,
    ]
    assert Session.objects.get().ended_at == after(0)


def test_a_visitor_who_came_back_is_not_ended_by_an_older_decision(giraff, ana, monkeypatch):
    """The session manager reads, decides that the grace is over, and the visitor returns before it
    acts.
    """
    granted = store.take(giraff, ana, "peer-1", now=NOW)
    Session.objects.update(state="reconnecting", lost_at=NOW)
    load = store.load_scene

    def then_the_visitor_returns(robot, now):
        scene = load(robot, now)
        monkeypatch.setattr("sessions.leases.expiry.load_scene", load)
        assert isinstance(
            store.take(robot, ana, "peer-2", session=granted.session, now=after(100)),
            store.TakeGranted,
        )
        return scene

    monkeypatch.setattr("sessions.leases.expiry.load_scene", then_the_visitor_returns)
    link = RobotLink(
        since=NOW.timestamp(),
        last_received_at=after(100).timestamp(),
        state_at=after(100).timestamp(),
    )
    assert tick(giraff, link, after(100)) == ()
    assert Session.objects.get().state == "reconnecting"


def test_a_look_reads_no_more_for_many_driven_robots_than_for_one(ana, ben, monkeypatch):
    """It is made twice a second, beside whatever else the computer does."""
    # no renewal comes early
    monkeypatch.setattr("sessions.manager.scheduler.random.random", lambda: 0.0)

    def queries(robots: int) -> int:
        for number in range(Robot.objects.count(), robots):
            made = create_robot(
                name=f"r{number}", title="R", connection="ONLINE", last_seen_at=after(1000)
            )
            assert isinstance(store.take(made, ana, f"peer-{number}", now=NOW), store.TakeGranted)
        Session.objects.update(state="driving", driving_at=NOW, first_motion_at=NOW, seen_at=NOW)
        links = {
            robot.name: RobotLink(
                NOW.timestamp(),
                after(1).timestamp(),
                after(1).timestamp(),
                str(robot.lease.session_id),
                1,
                0.1,
            )
            for robot in Robot.objects.all()
        }
        keeper = Scheduler()
        keeper.tick(links, RobotLink(since=NOW.timestamp()), after(0.5))
        keeper.renew(after(0.5))
        with CaptureQueriesContext(connection) as asked:
            keeper.tick(links, RobotLink(since=NOW.timestamp()), after(1))
            assert not keeper.renew(after(1)), "nothing is due"
        assert not [query for query in asked if not query["sql"].startswith("SELECT")]
        return len(asked)

    few = queries(1)
    assert queries(12) == few <= 10


def test_a_sign_that_comes_while_the_end_is_decided_keeps_the_robot(
    giraff, ana, monkeypatch, settings
):
    settings.IDLE_SECONDS = 60.0
    granted = store.take(giraff, ana, "peer-1", now=NOW)
    Session.objects.update(state="driving", driving_at=NOW, seen_at=after(100))
    signs, asked = {}, (granted.session, after(61).timestamp())
    heard = {"last_received_at": after(100).timestamp(), "state_at": after(100).timestamp()}
    link = RobotLink(
        since=NOW.timestamp(),
        **heard,
        session=granted.session,
        epoch=1,
        silence=0.1,
        asked=asked,
        signs=signs,
    )

    def then_the_sign_comes(*known):
        acts = decide_tick(*known)
        signs[granted.session] = after(100.1).timestamp()
        return acts

    with monkeypatch.context() as patched:
        patched.setattr("sessions.leases.expiry.decide_tick", then_the_sign_comes)
        assert tick(giraff, link, after(100)) == ()
    assert Session.objects.get().state == "driving"
    signs.clear()
    assert tick(giraff, link, after(100)) == (
        Ended(session=granted.session, outcome="timed_out", reason=IDLE),
    )


def test_a_process_that_died_between_lease_and_session_is_made_good(giraff, ana, ben):
    granted = store.take(giraff, ana, "peer-1", now=NOW)
    Session.objects.update(state="waiting")
    link = RobotLink(since=NOW.timestamp(), last_received_at=NOW.timestamp())
    assert tick(giraff, link, after(1)) == (SetState(granted.session, "connecting"),)
    # and its end, without the lease
    Session.objects.update(state="ended", live_key="x", outcome="cancelled")
    assert tick(giraff, link, after(2)) == (ReleaseLease(1),)
    assert isinstance(store.take(giraff, ben, "peer-2", now=after(3)), store.TakeGranted)


def test_robots_that_were_taken_together_are_renewed_apart_and_each_in_time(ana, monkeypatch):
    monkeypatch.setattr("sessions.manager.scheduler.random.random", random.Random(1).random)
    robots = [
        create_robot(name=f"r{number}", title="R", connection="ONLINE", last_seen_at=after(1000))
        for number in range(12)
    ]
    for robot in robots:
        assert isinstance(store.take(robot, ana, f"peer-{robot.name}", now=NOW), store.TakeGranted)
    Session.objects.update(state="driving", driving_at=NOW, first_motion_at=NOW, seen_at=NOW)
    keeper, reasons = Scheduler(), {robot.name: [] for robot in robots}
    for look in range(21):
        seconds = look * 0.5
        while keeper.renew(after(seconds)):
            for outbound in keeper.outbox:
                robot, suffix = topics.parse(outbound.topic)
                assert suffix == "lease"
                reasons[robot].append(seconds)
            keeper.outbox.clear()
    assert all(at[0] == 0.0 for at in reasons.values())
    assert all(
        0.0 < later - at <= settings.LEASE_RENEWAL_SECONDS
        for moments in reasons.values()
        for at, later in pairwise(moments)
    )
    assert len({tuple(moments) for moments in reasons.values()}) > 1, "all at once for ever"


def test_that_nobody_drives_is_told_before_the_news_of_what_has_ended(giraff, ana):
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


def test_a_turn_has_an_end_while_somebody_waits_and_none_when_they_have_left(giraff, ana, ben):
    granted = store.take(giraff, ana, "peer-1", now=NOW)
    Session.objects.update(state="driving", driving_at=NOW, first_motion_at=NOW)
    keeper = Scheduler()

    def turn_ends_at(seconds):
        now = after(seconds).timestamp()
        link = RobotLink(
            since=NOW.timestamp(),
            last_received_at=now,
            state_at=now,
            session=granted.session,
            epoch=granted.epoch,
            silence=0.1,
            moved=True,
            active_at=now,
        )
        keeper.tick({"giraff": link}, RobotLink(since=NOW.timestamp()), after(seconds))
        return Session.objects.get(pk=granted.session).turn_ends_at

    assert turn_ends_at(1) is None
    waiting = store.take(giraff, ben, "peer-2", now=after(2))
    assert turn_ends_at(3) == after(900)
    store.leave(waiting.session, peer="peer-2", now=after(4))
    assert turn_ends_at(5) is None
    noted = SessionEvent.objects.filter(session=granted.session, type__startswith="turn_")
    assert set(noted.values_list("type", flat=True)) == {"turn_limited", "turn_unlimited"}


def test_a_grant_that_begins_while_the_scene_is_read_is_not_taken_for_a_leftover(
    giraff, ana, monkeypatch
):
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
    assert (
        tick(giraff, RobotLink(since=NOW.timestamp(), last_received_at=NOW.timestamp()), NOW) == ()
    )
    assert Lease.objects.get().session.visitor == ana


def test_the_queue_is_offered_the_robot_in_order(giraff, ana, ben):
    first = store.take(giraff, ana, "peer-1", now=NOW)
    queued = store.take(giraff, ben, "peer-2", now=NOW)
    store.leave(first.session, peer="peer-1", now=after(1))
    link = RobotLink(since=NOW.timestamp(), last_received_at=NOW.timestamp())
    assert tick(giraff, link, after(1)) == (
        Offered(session=queued.session, seconds=settings.START_SECONDS),
    )
    assert isinstance(store.take(giraff, ana, "peer-1", now=after(2)), store.Queued)
    store.seen({queued.session}, after(70))
    assert Ended(session=queued.session, outcome="cancelled", reason="turn_not_taken") in tick(
        giraff, link, after(70)
    )


STOPPED = {"safety": {"estop": True, "estopSource": "screen:Giraff"}}
FAULTY = {"safety": {"inhibited": "fault"}}
LOST = {"safety": {"inhibited": "fault"}, "errors": ["adapter_lost: no answer"]}

RUNS_ON = {"safety": {"inhibited": "no_lease"}, "errors": ["runs_on: the robot keeps moving"]}


@pytest.mark.parametrize(
    ("report", "reason"),
    [(STOPPED, "estop"), (FAULTY, "fault"), (LOST, "not_connected"), (RUNS_ON, "fault")],
)
def test_a_robot_that_cannot_drive_is_offered_to_none_and_places_are_kept(
    giraff, ana, ben, report, reason
):
    RobotPresence.objects.update(report=report)
    giraff.refresh_from_db()
    first = store.take(giraff, ana, "peer-1", now=NOW)
    second = store.take(giraff, ben, "peer-2", now=after(1))
    assert [(reasons.place, reasons.reason) for reasons in (first, second)] == [
        (1, f"paused: {reason}"),
        (2, f"paused: {reason}"),
    ]
    assert tick(giraff, RobotLink(), after(2)) == ()
    RobotPresence.objects.update(report={"safety": {"estop": False, "inhibited": "no_lease"}})
    assert [act.session for act in tick(giraff, RobotLink(), after(3))] == [first.session]
    RobotPresence.objects.update(report=report)  # before the turn was taken
    tick(giraff, RobotLink(), after(4))
    again = store.take(giraff, ana, "peer-1", session=first.session, now=after(5))
    assert (again.place, again.reason) == (1, f"paused: {reason}")


@pytest.mark.parametrize("report", [STOPPED, RUNS_ON])
def test_a_driver_keeps_a_robot_that_cannot_drive_even_after_a_reload(giraff, ana, report):
    granted = store.take(giraff, ana, "peer-1", now=NOW)
    RobotPresence.objects.update(report=report)
    link = RobotLink(since=NOW.timestamp(), last_received_at=NOW.timestamp())
    assert tick(giraff, link, after(1)) == ()
    back = store.take(
        giraff, ana, "peer-2", session=granted.session, old_peer="peer-1", now=after(1)
    )
    assert isinstance(back, store.TakeGranted)


def test_an_operator_may_take_a_stopped_robot_to_release_it(giraff, ana, ben):
    update_robots(report=STOPPED, owner=ben)
    giraff.refresh_from_db()
    store.take(giraff, ana, "peer-1", now=NOW)
    assert isinstance(store.take(giraff, ben, "peer-2", now=after(1)), store.TakeGranted)


# --- another process is quicker -------------------------------------------------------------------


def meanwhile(monkeypatch, name, happens):
    """Have something happen just after a function of the store was called first."""
    original, pending = getattr(store, name), [happens]

    def call(*values, **words):
        found = original(*values, **words)
        if pending:
            pending.pop()()
        return found

    monkeypatch.setattr(store, name, call)


def test_two_tabs_that_ask_for_a_free_robot_at_once_get_one_session(giraff, ana, monkeypatch):
    first = []
    meanwhile(
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
    meanwhile(
        monkeypatch, "load_scene", lambda: first.append(store.take(giraff, ben, "peer-2", now=NOW))
    )
    second = store.take(giraff, ben, "peer-3", now=NOW)
    assert (first[0].place, second.place, second.session) == (1, 1, first[0].session)
    assert Session.objects.filter(visitor=ben).count() == 1


def test_of_two_visitors_who_ask_at_once_one_drives_and_one_waits(giraff, ana, ben, monkeypatch):
    meanwhile(monkeypatch, "load_scene", lambda: store.take(giraff, ana, "peer-1", now=NOW))
    taken = store.take(giraff, ben, "peer-2", now=NOW)
    assert isinstance(taken, store.Queued)
    assert Lease.objects.get().peer == "peer-1"


def test_a_visitor_who_leaves_in_one_tab_while_another_is_granted_gets_a_new_session(
    giraff, ana, monkeypatch
):
    left = []

    def leave():
        left.append(Session.objects.get().pk)
        Session.objects.update(state="ended", outcome="cancelled", live_key=str(left[0]))

    meanwhile(monkeypatch, "fix_terms", leave)
    granted = store.take(giraff, ana, "peer-1", now=NOW)
    assert granted.session != str(left[0])
    assert str(Lease.objects.get().session_id) == granted.session


def test_a_lease_that_changes_under_every_attempt_is_an_error(giraff, ana, monkeypatch):
    monkeypatch.setattr(store, "ATTEMPTS", 3)
    monkeypatch.setattr(store, "change_lease", lambda *_, **__: False)
    with pytest.raises(store.LeaseContention, match="giraff"):
        store.take(giraff, ana, "peer-1", now=NOW)
    assert Lease.objects.get().session is None


def test_a_page_that_drives_no_more_chooses_no_assistance(giraff, ana):
    first = store.take(giraff, ana, "peer-1", now=NOW)
    assert store.set_assist(first.session, "slow", peer="peer-2") is None
    lease = store.set_assist(first.session, "slow", peer="peer-1")
    assert (str(lease.session_id), lease.renewal) == (first.session, 1)
    Session.objects.update(state="ended")
    assert store.set_assist(first.session, "steer", peer="peer-1") is None
    assert Session.objects.get().assist == "slow"
