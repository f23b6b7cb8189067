"""Notices of the scheduler to pages, which it repeats if one may have been lost."""

import contextlib
import datetime
import json

import pytest
from django.db import OperationalError, connection

from accounts.models import AuditEntry, User
from robots.api import codec, topics
from robots.models import RobotPresence
from sessions import protocol
from sessions.leases import store, terms
from sessions.leases.transitions import RobotLink
from sessions.manager.scheduler import Scheduler
from sessions.models import Lease, Maintenance, Session, SessionEvent, SystemLog
from sessions.protocol import Ended, Offered, PresenceAsked, PresenceConfirmed, Queued, TurnWarning
from tests.support.robots import online_robot, update_robots
from tests.support.sessions.rows import NOW, after

pytestmark = pytest.mark.django_db


@pytest.fixture
def drive():
    """The session of a driver, while another visitor waits."""
    giraff = online_robot()
    ana, ben = (User.objects.create(username=name) for name in ("ana", "ben"))
    session = store.take(giraff, ana, "p1", now=NOW).session
    Session.objects.update(state="driving", driving_at=NOW, first_motion_at=NOW)
    store.take(giraff, ben, "p2", now=NOW)
    return session


@pytest.fixture
def offered(drive, settings):
    """The session of a waiting visitor to whom the robot has just been offered."""
    settings.START_SECONDS = 60.0
    assert store.leave(drive, peer="p1", now=after(1))
    return str(Session.objects.get(state="waiting").pk)


def sent_by(scheduler, seconds, kind=Offered, **link):
    """Run one tick with these messages of the robot; return the notices of this kind since the
    previous one.
    """
    scheduler.tick({}, RobotLink(since=NOW.timestamp(), **link), after(seconds))
    frames = [outbound.payload.decode() for outbound in scheduler.outbox if not outbound.retain]
    scheduler.outbox.clear()
    notices = [protocol.decode_notice(frame) for frame in frames]
    return [notice for notice in notices if isinstance(notice, kind)]


def refused_then_sent(scheduler, seconds, kind, **link):
    """Return the notices of this kind of the tick after one in which the database refused to record
    them.
    """

    def refuses(execute, sql, params, *args):
        if sql.startswith("INSERT") and protocol.NOTICE_NAMES[kind] in params:
            raise OperationalError
        return execute(sql, params, *args)

    with connection.execute_wrapper(refuses), pytest.raises(OperationalError):
        sent_by(scheduler, seconds, kind, **link)
    scheduler.outbox.clear()
    return sent_by(scheduler, seconds + 1, kind, **link)


def test_offer_is_sent_once(offered):
    scheduler = Scheduler()
    assert sent_by(scheduler, 2) == [Offered(session=offered, seconds=60.0)]
    assert sent_by(scheduler, 3) == []


def test_offer_of_a_killed_session_manager_is_sent_by_the_next(offered):
    sent_by(Scheduler(), 2)  # and was killed before it published it
    successor = Scheduler()
    assert sent_by(successor, 12) == [Offered(session=offered, seconds=50.0)]
    assert sent_by(successor, 13) == []


@pytest.mark.django_db(transaction=True)
def test_offer_that_could_not_be_recorded_is_sent_at_the_next_tick(offered):
    scheduler = Scheduler()
    assert refused_then_sent(scheduler, 2, Offered) == [Offered(session=offered, seconds=59.0)]
    assert sent_by(scheduler, 4) == []


def test_offer_is_sent_again_to_a_broker_that_may_have_lost_it(offered):
    scheduler = Scheduler()
    sent_by(scheduler, 2)
    scheduler.begin()
    assert sent_by(scheduler, 12) == [Offered(session=offered, seconds=50.0)]


def test_visitor_whose_offer_was_withdrawn_gets_their_place_again(offered):
    scheduler = Scheduler()
    sent_by(scheduler, 2)
    update_robots(turnaround="paused", turnaround_reason="estop", returns_home=True)
    assert [notice.session for notice in sent_by(scheduler, 3, Queued)] == [offered]
    RobotPresence.objects.update(turnaround="ready")
    assert [notice.session for notice in sent_by(scheduler, 5)] == [offered]


@pytest.fixture
def warned(drive, settings):
    """The link of a robot whose driver is to be warned of the end of the turn."""
    settings.TURN_WARNING_SECONDS, settings.IDLE_SECONDS = 10_000.0, 0.0
    Session.objects.update(seen_at=after(1000))
    at = after(1).timestamp()
    return {"last_received_at": at, "state_at": at, "session": drive, "epoch": 1, "silence": 0.1}


def test_warning_is_sent_again_to_a_broker_that_may_have_lost_it(drive, warned):
    scheduler = Scheduler()
    assert [notice.session for notice in sent_by(scheduler, 1, TurnWarning, **warned)] == [drive]
    assert sent_by(scheduler, 1.5, TurnWarning, **warned) == []
    scheduler.begin()
    assert [notice.session for notice in sent_by(scheduler, 2, TurnWarning, **warned)] == [drive]
    assert SessionEvent.objects.filter(type="turn_warning").count() == 1


def test_driver_learns_that_the_maintenance_was_called_off(drive, warned):
    Session.objects.exclude(pk=drive).delete()  # no turn ends, as no other visitor waits
    scheduler, end = Scheduler(), {"session": drive, "reason": "maintenance"}
    Maintenance.objects.create(starts_at=after(301))
    assert sent_by(scheduler, 1, TurnWarning, **warned) == [TurnWarning(remaining=300.0, **end)]
    assert sent_by(scheduler, 2, TurnWarning, **warned) == []
    Maintenance.objects.all().delete()
    withdrawn = TurnWarning(session=drive, remaining=None)
    assert sent_by(scheduler, 3, TurnWarning, **warned) == [withdrawn]
    assert sent_by(scheduler, 4, TurnWarning, **warned) == []


def test_maintenance_ends_the_drive_and_frees_the_robot(drive, warned):
    Maintenance.objects.create(starts_at=after(1))
    sent_by(Scheduler(), 2, **warned)
    ended = Session.objects.get(pk=drive)
    assert (ended.outcome, ended.outcome_reason) == ("stopped_by_operator", "maintenance")
    assert not Lease.objects.filter(session=drive).exists()


@pytest.mark.django_db(transaction=True)
def test_warning_that_could_not_be_recorded_is_sent_at_the_next_tick(drive, warned):
    (warning,) = refused_then_sent(Scheduler(), 1, TurnWarning, **warned)
    assert warning.session == drive


@pytest.mark.django_db(transaction=True)
def test_presence_check_that_could_not_be_recorded_is_sent_at_the_next_tick(drive, settings):
    settings.IDLE_SECONDS = 4.0
    Session.objects.update(seen_at=after(1000))
    scheduler, at = Scheduler(), after(5).timestamp()
    idle = {"last_received_at": at, "state_at": at, "session": drive, "epoch": 1, "silence": 0.1}
    (asked,) = refused_then_sent(scheduler, 5, PresenceAsked, **idle)
    assert asked.session == drive
    back = {**idle, "active_at": after(7).timestamp()}
    assert refused_then_sent(scheduler, 7, PresenceConfirmed, **back) == [
        PresenceConfirmed(session=drive)
    ]


def test_grant_of_an_idle_robot_is_not_ended_by_the_robots_silence(drive):
    """A web process has changed the lease, and not yet the session; an idle robot sends a message
    every 30 s.
    """
    Session.objects.filter(pk=drive).update(state="waiting", granted_at=None, driving_at=None)
    link = (NOW - datetime.timedelta(seconds=20)).timestamp()
    idle = RobotLink(since=link, last_received_at=link, state_at=link)
    Scheduler().tick({"giraff": idle}, idle, after(1))
    session = Session.objects.get(pk=drive)
    assert (session.state, session.granted_at) == ("connecting", after(1))
    Scheduler().tick({"giraff": idle}, idle, after(60))
    broken_off = {"outcome": "robot_fault", "reason": "robot_offline"}
    assert SystemLog.objects.get(event="session_broken_off").fields == broken_off


def test_two_versions_of_a_lease_never_have_the_same_number(drive, monkeypatch):
    scheduler, numbers = Scheduler(), []

    def renew():
        scheduler.begin()
        scheduler.renew(after(1))
        copies = [json.loads(one.payload) for one in scheduler.outbox if one.retain]
        numbers.extend(copy["renewal"] for copy in copies)
        scheduler.outbox.clear()

    def renew_during_update(execute, sql, params, many, context):
        if sql.startswith('UPDATE "telepresence_sessions_lease"') and "renewal" in sql:
            watching.pop().close()
            renew()
        return execute(sql, params, many, context)

    watching = [contextlib.ExitStack()]
    watching[0].enter_context(connection.execute_wrapper(renew_during_update))
    chosen = store.set_assist(drive, "slow", peer="p1").renewal
    renew()
    assert len({*numbers, chosen}) == 3
    assert max(numbers) > chosen > min(numbers)


def test_session_with_unreadable_terms_ends_and_the_others_go_on(drive, settings):
    """As after an upgrade, or a manual change of the database."""
    rhodon = online_robot("rhodon")
    other = store.take(rhodon, User.objects.create(username="cem"), "p3", now=NOW).session
    Session.objects.filter(pk=drive).update(terms={"driver": "x", "study": {"slug": "s"}})
    scheduler = Scheduler()
    assert scheduler.renew(after(0.1)), "its robot allows nothing until then"
    leases = {
        topics.parse(one.topic)[0]: codec.decode("lease", one.payload) for one in scheduler.outbox
    }
    assert (leases["giraff"].methods, leases["giraff"].actions) == ((), ())
    assert leases["rhodon"].session == other
    ended = sent_by(scheduler, 1, Ended)
    assert [(one.session, one.outcome, one.reason) for one in ended] == [
        (drive, "stopped_by_operator", "terms_unreadable")
    ]
    row = Session.objects.get(pk=drive)
    assert terms.of(row).study == {"slug": "s"}
    assert Session.objects.get(pk=other).state != "ended"
    assert sent_by(scheduler, 2), "the robot is offered to the queue"


def test_another_version_of_the_site_is_noted_once(settings):
    settings.VERSION = "0.8.0"
    for _ in range(2):
        Scheduler().begin()
    settings.VERSION = "0.9.0"
    Scheduler().begin()
    noted = AuditEntry.objects.filter(act="site_changed").order_by("at")
    versions = [entry.data["version"] for entry in noted]
    assert versions == [[None, "0.8.0"], ["0.8.0", "0.9.0"]]
