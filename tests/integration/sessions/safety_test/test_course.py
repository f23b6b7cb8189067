"""A safety test from its start to its entry in the log of interventions."""

import pytest
from django.urls import reverse

from accounts.models import AuditEntry
from robots.api import codec, topics
from robots.api.messages import ActionStatus, Event, SafetyTest
from robots.models import Robot, RobotPresence
from sessions import signals
from sessions.leases import expiry, store
from sessions.leases.transitions import RobotLink
from sessions.manager.scheduler import Scheduler
from sessions.models import Lease, Session
from sessions.protocol import Queued
from sessions.safety_test import course
from tests.support.people import person
from tests.support.robots import online_robot
from tests.support.sessions.rows import NOW, after

pytestmark = pytest.mark.django_db
SHEET = {"capabilities": ["safety_test"], "agentVersion": "0.9.0", "adapter": "moos"}
FIGURES = {
    "silence_s": 0.41,
    "silence_m": 0.05,
    "silence_within_s": 0.7,
    "stop_s": 0.1,
    "stop_m": 0.01,
    "stop_within_s": 0.4,
    "stop_holds": True,
    "fastest": 0.15,
    "limit": 0.15,
}


@pytest.fixture
def owner():
    return person("owner", is_staff=True, display_name="Olga")


@pytest.fixture
def giraff(owner):
    robot = online_robot()
    Robot.objects.update(owner=owner, returns_home=False)
    RobotPresence.objects.update(factsheet=SHEET)
    return Robot.objects.select_related("presence").get(pk=robot.pk)


@pytest.fixture
def session(giraff, owner) -> Session:
    assert course.start(giraff, owner, NOW) == ""
    return Session.objects.get()


def report(session, status="FINISHED", reason="", result=None, robot="giraff"):
    lease = Lease.objects.filter(session=session).first()
    message = ActionStatus(
        action_id=lease.peer if lease else "gone",
        status=status,
        stamp=1.0,
        type="safety_test",
        reason=reason,
        result=result or {},
    )
    signals.message_received.send(
        Session,
        robot=robot,
        session=str(session.pk),
        message=message,
        received_at=NOW.timestamp(),
        clock_offset=None,
    )


def entry() -> AuditEntry:
    return AuditEntry.objects.get(act="safety_test")


def test_a_test_has_the_robot_slowly_and_no_visitor_gets_it(session, giraff):
    lease = store.message_of(Lease.objects.get(), NOW)
    assert lease.peer.startswith("safety_test-")
    assert (lease.limits.linear, lease.methods, lease.actions) == (0.15, ("script",), ("undock",))
    assert lease.assist == "slow"
    assert isinstance(store.take(giraff, person("ada"), "p1", now=after(1)), Queued)
    assert course.running(giraff) == session


def test_the_session_manager_orders_the_test_after_its_lease_until_it_has_begun(session, giraff):
    scheduler = Scheduler()
    scheduler.renew(after(1))
    names = [outbound.topic for outbound in scheduler.outbox]
    assert names == [topics.of("giraff", "lease"), topics.of("giraff", "command/action")]
    order = codec.decode("command/action", scheduler.outbox[1].payload, "to_robot")
    assert isinstance(order, SafetyTest)
    assert (order.role, order.user) == ("owner", "Olga")
    assert order.action_id == Lease.objects.get().peer
    Session.objects.update(state="driving")
    scheduler.outbox.clear()
    scheduler.renew(after(30))
    assert [outbound.topic for outbound in scheduler.outbox] == [topics.of("giraff", "lease")]


def test_an_ordinary_lease_brings_no_order(giraff):
    store.take(giraff, person("ada"), "p1", now=NOW)
    scheduler = Scheduler()
    scheduler.renew(after(1))
    assert [outbound.topic for outbound in scheduler.outbox] == [topics.of("giraff", "lease")]


def test_its_figures_are_stored_with_the_versions_and_the_robot_is_free_again(session, owner):
    report(session, result=FIGURES)
    report(session, result=FIGURES)  # signals can come twice
    row = entry()
    assert (row.actor, row.role, row.robot) == (owner.pk, "owner", "giraff")
    assert row.data["outcome"] == "passed"
    assert row.data["figures"] == FIGURES
    assert row.data["versions"]["agent"] == "0.9.0"
    assert row.data["versions"]["site"]
    session.refresh_from_db()
    assert (session.state, session.outcome) == ("ended", "completed")
    assert Lease.objects.get().session is None


@pytest.mark.parametrize(
    ("reason", "result", "outcome"),
    [
        ("too_late: silence", FIGURES, "failed"),
        ("stopped", {"limit": 0.15}, "broken_off"),
        ("docked", {}, "not_run"),
    ],
)
def test_a_test_that_did_not_pass_says_what_happened(session, reason, result, outcome):
    report(session, "FAILED", reason, result)
    assert (entry().data["outcome"], entry().data["reason"]) == (outcome, reason)
    assert Lease.objects.get().session is None


def test_another_robot_cannot_report_the_result(session):
    report(session, result=FIGURES, robot="rhodon")
    assert not AuditEntry.objects.filter(act="safety_test").exists()
    session.refresh_from_db()
    assert session.state == "connecting"


def test_an_event_of_the_session_and_a_test_of_no_session_are_no_result(session, giraff):
    event = Event(stamp=1.0, boot="b", seq=1, type="stopped")
    course.take_result("giraff", str(session.pk), event)
    store.end(str(session.pk), "cancelled", "left", NOW)
    other = store.take(giraff, person("ada"), "p1", now=after(1)).session
    report(Session.objects.get(pk=other), result=FIGURES)
    assert not AuditEntry.objects.filter(act="safety_test").exists()


def test_a_robot_that_is_lost_ends_its_test_and_the_entry_says_so(session, giraff):
    Session.objects.update(state="driving")
    link = RobotLink(since=NOW.timestamp(), last_received_at=NOW.timestamp() + 1)
    for seconds in (6, 8, 20):
        expiry.tick(giraff, link, after(seconds))
    Scheduler().tick({}, RobotLink(), after(21))
    session.refresh_from_db()
    assert session.state == "ended"
    assert (entry().data["outcome"], entry().data["reason"]) == ("broken_off", "visitor_silent")


def test_the_end_of_a_finished_test_adds_nothing(session):
    report(session, result=FIGURES)
    Scheduler().tick({}, RobotLink(), after(2))
    assert entry().data["outcome"] == "passed"


# --- the page -------------------------------------------------------------------------------------


@pytest.fixture
def address(giraff):
    return reverse("admin:telepresence_sessions_safety_test", args=[giraff.pk])


@pytest.fixture
def here(client, owner, monkeypatch):
    """Log the owner in, at the time at which the robot is online."""
    client.force_login(owner)
    monkeypatch.setattr("sessions.safety_test.page.timezone.now", lambda: NOW)
    return client


def test_an_owner_starts_a_test_after_confirming_that_the_floor_is_free(here, address, giraff):
    words = here.get(address).content.decode()
    assert "up to 50 cm" in words
    assert "Start the test" in words
    answer = here.post(address, {"action": "start"}, follow=True)
    assert "Confirm that the floor" in answer.content.decode()
    assert course.running(giraff) is None
    answer = here.post(address, {"action": "start", "free": "yes"}, follow=True)
    assert "The test is running" in answer.content.decode()
    assert answer["Refresh"] == "3"
    assert course.running(giraff) is not None


def test_an_owner_ends_a_running_test(here, address, session):
    here.post(address, {"action": "end"})
    assert Lease.objects.get().session is None
    session.refresh_from_db()
    assert session.outcome == "stopped_by_operator"


@pytest.mark.parametrize(
    ("report", "words"),
    [
        ({"docked": True}, "on its charging station"),
        ({"mode": "goto"}, "drives by itself"),
        ({"safety": {"estop": True}}, "emergency stop is on"),
    ],
)
def test_the_page_says_why_a_test_cannot_start(here, address, report, words):
    RobotPresence.objects.update(report=report)
    answer = here.get(address).content.decode()
    assert words in answer
    assert "Start the test" not in answer
    here.post(address, {"action": "start", "free": "yes"})
    assert not Session.objects.exists()


def test_a_driven_robot_is_not_tested(here, address, giraff):
    store.take(giraff, person("ada"), "p1", now=NOW)
    assert "A visitor has the robot" in here.get(address).content.decode()


def test_the_page_shows_figures_and_what_was_too_late(here, address, session):
    report(session, "FAILED", "too_late: silence", FIGURES)
    words = here.get(address).content.decode()
    assert "0.41\u00a0s" in words
    assert "It stopped later than it must (no commands)" in words
    assert "agent 0.9.0" in words


def test_only_users_who_may_change_the_robot_see_its_test(client, address):
    client.force_login(person("ada"))
    assert client.get(address).status_code in {302, 403, 404}
    client.force_login(person("ben", is_staff=True))
    assert client.get(address).status_code in {403, 404}
