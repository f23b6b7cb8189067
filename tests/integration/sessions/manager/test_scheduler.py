"""What the scheduler says to pages, and says again when it may have got lost."""

import contextlib
import datetime
import json

import pytest
from django.db import OperationalError, connection
from django.utils import timezone

from accounts.models import User
from robots.api import codec, topics
from robots.models import Robot, RobotPresence
from sessions import protocol
from sessions.leases import store, terms
from sessions.leases.transitions import RobotLink
from sessions.manager.scheduler import Scheduler
from sessions.models import Session, SessionEvent
from sessions.protocol import AskedThere, Ended, FoundThere, Offered, Queued, TurnWarning
from tests.support.robots import create_robot, update_robots

pytestmark = pytest.mark.django_db
NOW = timezone.now()


def after(seconds):
    return NOW + datetime.timedelta(seconds=seconds)


@pytest.fixture
def driven():
    """The session of a driver, while another visitor waits."""
    giraff = create_robot(
        name="giraff", title="Giraff", connection="ONLINE", last_seen_at=after(1000)
    )
    ana, ben = (User.objects.create(username=name) for name in ("ana", "ben"))
    session = store.take(giraff, ana, "p1", now=NOW).session
    Session.objects.update(state="driving", driving_at=NOW, first_motion_at=NOW)
    store.take(giraff, ben, "p2", now=NOW)
    return session


@pytest.fixture
def offered(driven, settings):
    """The session of a waiting visitor to whom the robot has just been offered."""
    settings.START_SECONDS = 60.0
    assert store.leave(driven, peer="p1", now=after(1))
    return str(Session.objects.get(state="waiting").pk)


def said(scheduler, seconds, kind=Offered, **heard):
    """Run one tick with these messages of the robot; return the notices of this kind since the
    previous one.
    """
    scheduler.tick({}, RobotLink(since=NOW.timestamp(), **heard), after(seconds))
    frames = [letter.payload.decode() for letter in scheduler.outbox if not letter.retain]
    scheduler.outbox.clear()
    notices = [protocol.decode_notice(frame) for frame in frames]
    return [notice for notice in notices if isinstance(notice, kind)]


def refused_then_said(scheduler, seconds, kind, **heard):
    """Return what it says of this kind at the look after one that the database broke off, when this
    was to be recorded.
    """

    def refuses(execute, sql, params, *args):
        if sql.startswith("INSERT") and protocol.NOTICE_NAMES[kind] in params:
            raise OperationalError
        return execute(sql, params, *args)

    with connection.execute_wrapper(refuses), pytest.raises(OperationalError):
        said(scheduler, seconds, kind, **heard)
    scheduler.outbox.clear()
    return said(scheduler, seconds + 1, kind, **heard)


def test_an_offer_is_said_once(offered):
    scheduler = Scheduler()
    assert said(scheduler, 2) == [Offered(session=offered, seconds=60.0)]
    assert said(scheduler, 3) == []


def test_an_offer_that_its_session_manager_did_not_live_to_say_is_said_by_the_next(offered):
    said(Scheduler(), 2)  # and was killed before its loop published it
    successor = Scheduler()
    assert said(successor, 12) == [Offered(session=offered, seconds=50.0)]
    assert said(successor, 13) == []


@pytest.mark.django_db(transaction=True)
def test_an_offer_that_the_database_refused_to_record_is_said_at_the_next_look(offered):
    scheduler = Scheduler()
    assert refused_then_said(scheduler, 2, Offered) == [Offered(session=offered, seconds=59.0)]
    assert said(scheduler, 4) == []


def test_an_offer_is_said_again_to_a_broker_that_may_have_lost_it(offered):
    scheduler = Scheduler()
    said(scheduler, 2)
    scheduler.begin()
    assert said(scheduler, 12) == [Offered(session=offered, seconds=50.0)]


def test_whose_offer_was_taken_back_is_told_their_place_again(offered):
    scheduler = Scheduler()
    said(scheduler, 2)
    update_robots(turnaround="paused", turnaround_reason="estop", returns_home=True)
    assert [notice.session for notice in said(scheduler, 3, Queued)] == [offered]
    RobotPresence.objects.update(turnaround="ready")
    assert [notice.session for notice in said(scheduler, 5)] == [offered]


@pytest.fixture
def warned(driven, settings):
    """The link of a robot whose driver is to be warned of the end of the turn."""
    settings.TURN_WARNING_SECONDS, settings.IDLE_SECONDS = 10_000.0, 0.0
    Session.objects.update(seen_at=after(1000))
    at = after(1).timestamp()
    return {"last_received_at": at, "state_at": at, "session": driven, "epoch": 1, "silence": 0.1}


def test_a_driver_is_warned_again_over_a_broker_that_may_have_lost_the_warning(driven, warned):
    scheduler = Scheduler()
    assert [notice.session for notice in said(scheduler, 1, TurnWarning, **warned)] == [driven]
    assert said(scheduler, 1.5, TurnWarning, **warned) == []
    scheduler.begin()
    assert [notice.session for notice in said(scheduler, 2, TurnWarning, **warned)] == [driven]
    assert SessionEvent.objects.filter(type="turn_warning").count() == 1


@pytest.mark.django_db(transaction=True)
def test_a_driver_is_warned_after_the_database_refused_to_record_it(driven, warned):
    (warning,) = refused_then_said(Scheduler(), 1, TurnWarning, **warned)
    assert warning.session == driven


@pytest.mark.django_db(transaction=True)
def test_a_driver_is_asked_and_found_after_the_database_refused_to_record_it(driven, settings):
    settings.IDLE_SECONDS = 4.0
    Session.objects.update(seen_at=after(1000))
    scheduler, at = Scheduler(), after(5).timestamp()
    idle = {"last_received_at": at, "state_at": at, "session": driven, "epoch": 1, "silence": 0.1}
    (asked,) = refused_then_said(scheduler, 5, AskedThere, **idle)
    assert asked.session == driven
    back = {**idle, "active_at": after(7).timestamp()}
    assert refused_then_said(scheduler, 7, FoundThere, **back) == [FoundThere(session=driven)]


def test_a_grant_of_an_idle_robot_is_not_ended_by_the_robots_silence(driven):
    """A web process has changed the lease, and not yet the session: an idle robot says something
    every half a minute.
    """
    Session.objects.filter(pk=driven).update(state="waiting", granted_at=None, driving_at=None)
    heard = (NOW - datetime.timedelta(seconds=20)).timestamp()
    idle = RobotLink(since=heard, last_received_at=heard, state_at=heard)
    Scheduler().tick({"giraff": idle}, idle, after(1))
    session = Session.objects.get(pk=driven)
    assert (session.state, session.granted_at) == ("connecting", after(1))
    Scheduler().tick({"giraff": idle}, idle, after(60))
    assert Session.objects.get(pk=driven).outcome_reason == "robot_offline"


def test_two_copies_of_a_lease_never_have_one_number(driven, monkeypatch):
    scheduler, numbers = Scheduler(), []

    def renew():
        scheduler.begin()
        scheduler.renew(after(1))
        copies = [json.loads(one.payload) for one in scheduler.outbox if one.retain]
        numbers.extend(copy["renewal"] for copy in copies)
        scheduler.outbox.clear()

    def meanwhile(execute, sql, params, many, context):
        if sql.startswith('UPDATE "telepresence_sessions_lease"') and "renewal" in sql:
            watching.pop().close()
            renew()
        return execute(sql, params, many, context)

    watching = [contextlib.ExitStack()]
    watching[0].enter_context(connection.execute_wrapper(meanwhile))
    chosen = store.set_assist(driven, "slow", peer="p1").renewal
    renew()
    assert len({*numbers, chosen}) == 3
    assert max(numbers) > chosen > min(numbers)


def test_a_session_with_unreadable_terms_ends_and_the_others_go_on(driven, settings):
    """As after an upgrade, or a hand in the database."""
    rhodon = create_robot(
        name="rhodon", title="Rhodon", connection="ONLINE", last_seen_at=after(1000)
    )
    other = store.take(rhodon, User.objects.create(username="cem"), "p3", now=NOW).session
    Session.objects.filter(pk=driven).update(terms={"driver": "x", "study": {"slug": "s"}})
    scheduler = Scheduler()
    assert scheduler.renew(after(0.1)), "until then, its robot obeys nothing"
    leases = {
        topics.parse(one.topic)[0]: codec.decode("lease", one.payload) for one in scheduler.outbox
    }
    assert (leases["giraff"].methods, leases["giraff"].actions) == ((), ())
    assert leases["rhodon"].session == other
    ended = said(scheduler, 1, Ended)
    assert [(one.session, one.outcome, one.reason) for one in ended] == [
        (driven, "stopped_by_operator", "terms_unreadable")
    ]
    row = Session.objects.get(pk=driven)
    assert terms.of(row).study == {"slug": "s"}
    assert Session.objects.get(pk=other).state != "ended"
    assert said(scheduler, 2), "who waited is offered the robot"
