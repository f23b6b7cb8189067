"""The server's absences, as the record of a session keeps them."""

import datetime

import pytest

from accounts.models import User
from sessions.leases import store
from sessions.leases.absences import WebAbsences, end_of, faults_of, note_manager_absence
from sessions.leases.fault_side import MANAGER, WEB, FaultAttribution
from sessions.leases.transitions import RobotLink
from sessions.manager.health import ManagerHealth
from sessions.manager.membership import Membership
from sessions.manager.scheduler import Scheduler
from sessions.models import Session, SessionEvent
from sessions.shards import rows
from tests.support.robots import online_robot
from tests.support.sessions.rows import NOW, after, chunk_row

pytestmark = pytest.mark.django_db


@pytest.fixture
def giraff():
    return online_robot()


@pytest.fixture
def drive(giraff):
    """Return the key of a session that drives; its page was seen at NOW."""
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


def test_open_page_that_is_no_longer_seen_shows_a_killed_web_process(giraff, drive):
    absences = WebAbsences()
    for seconds in (1.0, 20.0, 30.0, 31.0, 90.0):
        look(absences, giraff, seconds)
    look(WebAbsences(), giraff, 95.0)  # a session manager that has just started
    since = NOW.timestamp()
    assert noted(drive, "server_absent", "server_back") == [
        ("server_absent", {"part": WEB, "since": since})
    ]
    row = lost(drive, 3.0, 123.0)
    assert fault(row) == FaultAttribution("platform", WEB)
    assert end_of(row) == after(3.0), "the grace is no part of the drive"


def test_each_absence_and_each_return_of_a_web_process_is_recorded(giraff, drive):
    absences = WebAbsences()
    look(absences, giraff, 30.0)
    store.seen([drive], after(40.0))
    look(WebAbsences(), giraff, 41.0)
    look(absences, giraff, 41.0)
    look(absences, giraff, 80.0)
    kinds = [kind for kind, _ in noted(drive, "server_absent", "server_back")]
    assert kinds == ["server_absent", "server_back", "server_absent"]
    store.seen([drive], after(100.0))
    look(absences, giraff, 101.0)
    store.page_closed(drive, "peer-1", after(300.0), 1006)
    look(absences, giraff, 330.0)
    assert fault(lost(drive, 302.0, 422.0)) == FaultAttribution("network")


@pytest.mark.parametrize(("code", "side"), [(1001, "visitor"), (1006, "network")])
def test_page_that_closes_its_socket_shows_no_absent_server(giraff, drive, code, side):
    absences = WebAbsences()
    look(absences, giraff, 1.0)
    store.page_closed(drive, "peer-1", after(5.0), code)
    look(absences, giraff, 60.0)
    assert noted(drive, "server_absent", "page_closed") == [("page_closed", {"code": code})]
    assert fault(lost(drive, 7.0, 127.0)) == FaultAttribution(side)


def test_close_code_from_before_a_reconnection_does_not_explain_the_end(drive):
    store.page_closed(drive, "peer-1", after(5.0), 1001)
    store.seen([drive], after(8.0))
    assert fault(lost(drive, 10.0, 20.0)) == FaultAttribution("network")


def test_scheduler_records_the_absence_before_it_ends_the_session(giraff, drive):
    Session.objects.filter(pk=drive).update(state="reconnecting", lost_at=after(3.0))
    link = RobotLink(since=after(-60.0).timestamp(), last_received_at=after(500.0).timestamp())
    Scheduler().tick({"giraff": link}, link, after(500.0))
    row = Session.objects.get(pk=drive)
    assert (row.outcome, row.outcome_reason) == ("connection_lost", "visitor_silent")
    assert fault(row) == FaultAttribution("platform", WEB)


def test_session_manager_records_the_absence_of_the_previous_one(drive, tmp_path):
    rhodon = online_robot("rhodon")
    ben = User.objects.create(username="ben")
    other = store.take(rhodon, ben, "peer-2", now=after(-500.0)).session
    store.end(other, "completed", "left", after(-400.0))
    assert rows.occupy(0, None, "killed", after(-100.0))
    clock = [0.0]
    joining = Membership(tmp_path, ManagerHealth(), lambda: clock[0])
    assert not joining._join(), "the other one may still run"
    clock[0] = 10.0
    assert joining._join()
    assert joining._beat({})
    assert noted(other, "server_absent") == []
    ((_, data),) = noted(drive, "server_absent")
    assert (data["part"], data["since"]) == (MANAGER, after(-100.0).timestamp())
    assert data["until"] >= NOW.timestamp()
    assert fault(lost(drive, 30.0, 150.0)) == FaultAttribution("platform", MANAGER)


def test_absence_after_a_clean_stop_is_recorded_too(drive, tmp_path):
    assert rows.occupy(0, None, "stopped", after(-90.0))
    rows.give_back("stopped")
    assert Membership(tmp_path, ManagerHealth())._join()
    ((_, data),) = noted(drive, "server_absent")
    assert data["since"] == pytest.approx(after(-90.0).timestamp())


def test_first_session_manager_and_a_quick_change_are_no_absence(drive, tmp_path):
    first = Membership(tmp_path, ManagerHealth())
    assert first._join()
    rows.give_back(first.holder)
    assert Membership(tmp_path, ManagerHealth())._join()
    assert noted(drive, "server_absent") == []


def test_absence_is_recorded_once(drive):
    for seconds in (10.0, 12.0):
        note_manager_absence(after(2.0), after(seconds))
    assert len(noted(drive, "server_absent")) == 1


def test_session_with_a_silent_robot_ends_at_its_last_state(drive):
    states = [{"boot": "b", "seq": 0, "stamp": 0.0}]
    chunk_row(Session.objects.get(), states, received_at=after(50.0).timestamp())
    store.end(drive, "robot_fault", "robot_offline", after(81.0))
    row = Session.objects.get(pk=drive)
    assert abs(end_of(row) - after(50.0)) < datetime.timedelta(milliseconds=1)
    assert fault(row) == FaultAttribution("robot")
