"""The server's absences, as the record of a session keeps them."""

import datetime

import pytest
from django.utils import timezone

from accounts.models import User
from robots.models import Robot
from sessions.leases import store
from sessions.leases.absences import WebAbsences, end_of, faults_of, note_manager_absence
from sessions.leases.fault_side import MANAGER, WEB, FaultAttribution
from sessions.leases.transitions import RobotLink
from sessions.manager.health import ManagerHealth
from sessions.manager.membership import Membership
from sessions.manager.scheduler import Scheduler
from sessions.models import Session, SessionEvent, StateChunk
from sessions.shards import rows
from tests.support.robots import create_robot

pytestmark = pytest.mark.django_db
NOW = timezone.now()


def after(seconds: float) -> datetime.datetime:
    return NOW + datetime.timedelta(seconds=seconds)


@pytest.fixture
def giraff():
    return create_robot(
        name="giraff", title="Giraff", connection="ONLINE", last_seen_at=after(1000)
    )


@pytest.fixture
def driven(giraff):
    """A session that drives, whose page was seen at NOW."""
    ana = User.objects.create(username="ana")
    session = store.take(giraff, ana, "peer-1", now=NOW).session
    Session.objects.filter(pk=session).update(state="driving", driving_at=NOW)
    return session


def look(absences, robot, seconds):
    absences.tick(store.load_scene(robot, after(seconds)).holder, after(seconds))


def noted(session, *kinds):
    rows = SessionEvent.objects.filter(session=session, type__in=kinds).order_by("stamp")
    return [(row.type, row.data) for row in rows]


def lost(session, at, ended):
    Session.objects.filter(pk=session).update(state="reconnecting", lost_at=after(at))
    assert store.end(session, "connection_lost", "visitor_silent", after(ended))
    return Session.objects.get(pk=session)


def fault(row):
    return faults_of([row])[row.pk]


def test_a_page_that_was_never_closed_and_is_seen_no_more_had_its_web_process_killed(
    giraff, driven
):
    absences = WebAbsences()
    for seconds in (1.0, 20.0, 30.0, 31.0, 90.0):
        look(absences, giraff, seconds)
    look(WebAbsences(), giraff, 95.0)  # a session manager that has just started
    since = NOW.timestamp()
    assert noted(driven, "server_absent", "server_back") == [
        ("server_absent", {"part": WEB, "since": since})
    ]
    row = lost(driven, 3.0, 123.0)
    assert fault(row) == FaultAttribution("platform", WEB)
    assert end_of(row) == after(3.0), "the grace is no part of the drive"


def test_a_web_process_that_comes_back_is_noted_and_one_that_dies_twice_twice(giraff, driven):
    absences = WebAbsences()
    look(absences, giraff, 30.0)
    store.seen([driven], after(40.0))
    look(WebAbsences(), giraff, 41.0)
    look(absences, giraff, 41.0)
    look(absences, giraff, 80.0)
    kinds = [kind for kind, _ in noted(driven, "server_absent", "server_back")]
    assert kinds == ["server_absent", "server_back", "server_absent"]
    store.seen([driven], after(100.0))
    look(absences, giraff, 101.0)
    store.page_closed(driven, "peer-1", after(300.0), 1006)
    look(absences, giraff, 330.0)
    assert fault(lost(driven, 302.0, 422.0)) == FaultAttribution("network")


@pytest.mark.parametrize(("code", "side"), [(1001, "visitor"), (1006, "network")])
def test_a_page_that_closes_its_socket_leaves_no_absent_server(giraff, driven, code, side):
    absences = WebAbsences()
    look(absences, giraff, 1.0)
    store.page_closed(driven, "peer-1", after(5.0), code)
    look(absences, giraff, 60.0)
    assert noted(driven, "server_absent", "page_closed") == [("page_closed", {"code": code})]
    assert fault(lost(driven, 7.0, 127.0)) == FaultAttribution(side)


def test_a_code_from_before_a_page_came_back_says_nothing_of_the_end(driven):
    store.page_closed(driven, "peer-1", after(5.0), 1001)
    store.seen([driven], after(8.0))
    assert fault(lost(driven, 10.0, 20.0)) == FaultAttribution("network")


def test_the_scheduler_notes_the_absence_before_it_ends_the_session(giraff, driven):
    Session.objects.filter(pk=driven).update(state="reconnecting", lost_at=after(3.0))
    link = RobotLink(since=after(-60.0).timestamp(), last_received_at=after(500.0).timestamp())
    Scheduler().tick({"giraff": link}, link, after(500.0))
    row = Session.objects.get(pk=driven)
    assert (row.outcome, row.outcome_reason) == ("connection_lost", "visitor_silent")
    assert fault(row) == FaultAttribution("platform", WEB)


def test_a_session_manager_notes_how_long_nobody_led_in_the_sessions_of_that_time(driven, tmp_path):
    rhodon = create_robot(
        name="rhodon", title="Rhodon", connection="ONLINE", last_seen_at=after(1000)
    )
    ben = User.objects.create(username="ben")
    other = store.take(rhodon, ben, "peer-2", now=after(-500.0)).session
    store.end(other, "completed", "left", after(-400.0))
    assert rows.occupy(0, None, "killed", after(-100.0))
    clock = [0.0]
    joining = Membership(tmp_path, ManagerHealth(), lambda: clock[0])
    assert not joining._join(), "nothing says yet whether the other one lives"
    clock[0] = 10.0
    assert joining._join()
    assert joining._beat({})
    assert noted(other, "server_absent") == []
    ((_, data),) = noted(driven, "server_absent")
    assert (data["part"], data["since"]) == (MANAGER, after(-100.0).timestamp())
    assert data["until"] >= NOW.timestamp()
    assert fault(lost(driven, 30.0, 150.0)) == FaultAttribution("platform", MANAGER)


def test_a_session_manager_that_was_stopped_cleanly_was_away_too(driven, tmp_path):
    assert rows.occupy(0, None, "stopped", after(-90.0))
    rows.give_back("stopped")
    assert Membership(tmp_path, ManagerHealth())._join()
    ((_, data),) = noted(driven, "server_absent")
    assert data["since"] == pytest.approx(after(-90.0).timestamp())


def test_a_quick_change_of_session_managers_and_a_first_one_are_no_absence(driven, tmp_path):
    first = Membership(tmp_path, ManagerHealth())
    assert first._join()
    rows.give_back(first.holder)
    assert Membership(tmp_path, ManagerHealth())._join()
    assert noted(driven, "server_absent") == []


def test_an_absence_is_noted_once_however_often_it_is_tried(driven):
    for seconds in (10.0, 12.0):
        note_manager_absence(after(2.0), after(seconds))
    assert len(noted(driven, "server_absent")) == 1


def test_a_silent_robot_ends_a_session_with_its_last_state(driven):
    StateChunk.objects.create(
        session_id=driven,
        boot="b",
        first_seq=0,
        last_seq=0,
        count=1,
        first_stamp=0.0,
        last_stamp=0.0,
        received_at=after(50.0).timestamp(),
        states=[],
    )
    store.end(driven, "robot_fault", "robot_offline", after(81.0))
    row = Session.objects.get(pk=driven)
    assert abs(end_of(row) - after(50.0)) < datetime.timedelta(milliseconds=1)
    assert fault(row) == FaultAttribution("robot")
