"""Practice robots: how many run and when, their processes, and which one a visitor gets."""

import datetime
import functools

import pytest
from django.utils import timezone

from accounts.models import User
from robots.models import FloorPlan, Robot, RobotPresence
from sessions.models import Session
from sessions.practice import PracticePlace, choose
from telepresence_site.practice import robots
from telepresence_site.practice.pool import AGAIN, LINGER, Demand, decide
from telepresence_site.practice.supervisor import Supervisor
from tests.support.sessions.rows import session_row

NAMES = ["practice-1", "practice-2"]
NOW = 1_000_000.0
NOBODY = Demand(None, frozenset(), {})


def waits(at: float = NOW, *taken: str, left: dict[str, float] | None = None) -> Demand:
    """Return the demand of a visitor who waits since a moment."""
    return Demand(at, frozenset(taken), left or {})


def decided(demand, running=(), *, names=NAMES, since=NOW - 100.0, now=NOW):
    """Return the robots to stop and to start; those of `since` that do not run have died."""
    at = since if isinstance(since, dict) else dict.fromkeys(running, since)
    return decide(names, demand, at, running, now)


# --- how many -------------------------------------------------------------------------------------


def test_no_practice_robot_runs_without_a_visitor():
    assert decided(NOBODY) == ([], [])


def test_each_visitor_gets_a_practice_robot_until_all_are_taken():
    assert decided(waits()) == ([], ["practice-1"])
    assert decided(waits(), ["practice-1"]) == ([], [])
    assert decided(waits(NOW, "practice-1"), ["practice-1"]) == ([], ["practice-2"])
    assert decided(waits(NOW, *NAMES), NAMES) == ([], [])


def test_a_robot_that_nobody_needs_stays_for_a_while_and_then_ends():
    assert decided(waits(NOW - LINGER + 1.0), ["practice-1"]) == ([], [])
    assert decided(waits(NOW - LINGER), ["practice-1"]) == (["practice-1"], [])


def test_practice_continues_when_the_visitor_no_longer_waits():
    assert decided(waits(NOW - LINGER, "practice-1"), ["practice-1"]) == ([], [])


def test_a_robot_is_restarted_after_its_visitor():
    left = waits(left={"practice-1": NOW - 1.0})
    assert decided(left, ["practice-1"])[0] == ["practice-1"]
    started = dict.fromkeys(NAMES, NOW - 100.0)
    assert decided(left, ["practice-2"], since=started) == ([], [])
    assert decided(left, names=["practice-1"], since=started) == ([], ["practice-1"])


def test_a_robot_killed_during_a_visit_is_restarted_first_but_not_too_often():
    demand, died = Demand(None, frozenset({"practice-2"}), {}), {"practice-2": NOW - 1.0}
    assert "practice-2" not in decided(demand, since=died)[1]
    assert decided(demand, since=died, now=NOW - 1.0 + AGAIN) == ([], ["practice-2"])


# --- processes ------------------------------------------------------------------------------------


@pytest.fixture
def ana(db):
    return User.objects.create_user("ana", password="x")


@pytest.fixture
def practice(db, settings, tmp_path):
    settings.PRACTICE_ROBOTS, settings.CREDENTIALS_DIR = 1, tmp_path / "credentials"
    return robots.prepare(1, "mqtt://127.0.0.1:1")


@pytest.fixture
def supervisor(practice, tmp_path):
    made = supervise(practice, tmp_path)
    yield made
    made.children.stop()


def supervise(names, tmp_path) -> Supervisor:
    return Supervisor(names, tmp_path / "log", lambda _name: ["-c", "import time; time.sleep(600)"])


def process(supervisor: Supervisor):
    return supervisor._running["practice-1"].process


def visit(visitor: User, robot: Robot, **changes) -> Session:
    return session_row(robot, visitor, **{"seen_at": timezone.now(), **changes})


def drives(visitor: User) -> Session:
    robot, now = Robot.objects.get(name="practice-1"), timezone.now()
    return visit(visitor, robot, state=Session.State.DRIVING, granted_at=now)


def test_practice_robot_starts_when_a_visitor_waits_for_a_real_one(supervisor, ana):
    supervisor.look()
    assert supervisor._running == {}
    visit(ana, Robot.objects.create(name="giraff", title="Giraff"))
    supervisor.look()
    assert process(supervisor).poll() is None


def test_waiting_visitor_with_a_closed_page_gets_no_practice_robot(supervisor, ana):
    earlier = timezone.now() - datetime.timedelta(minutes=5)
    visit(ana, Robot.objects.create(name="giraff", title="Giraff"), seen_at=earlier)
    supervisor.look()
    assert supervisor._running == {}


def test_practice_robot_that_dies_is_restarted_for_its_driver(supervisor, ana, monkeypatch):
    monkeypatch.setattr("telepresence_site.practice.pool.AGAIN", 0.0)
    drives(ana)
    supervisor.look()
    first = process(supervisor)
    first.kill()
    first.wait()
    supervisor.look()
    assert process(supervisor) is not first
    assert process(supervisor).poll() is None


def test_new_supervisor_starts_the_robot_of_a_practising_visitor(
    supervisor, practice, ana, tmp_path
):
    drives(ana)
    supervisor.look()
    supervisor.children.stop()  # as when it is killed: its children die with it
    second = supervise(practice, tmp_path)
    try:
        second.look()
        assert process(second).poll() is None
    finally:
        second.children.stop()


def test_robot_whose_visitor_has_closed_the_page_is_freed_and_ended(supervisor, ana):
    session = drives(ana)
    supervisor.look()
    child = process(supervisor)
    leaves(session)
    supervisor.look()
    assert child.poll() is not None


def leaves(session: Session) -> None:
    Session.objects.filter(pk=session.pk).update(
        state=Session.State.ENDED, live_key=str(session.pk), ended_at=timezone.now()
    )


def test_ten_visitors_practise_in_turn_each_with_a_robot_of_their_own(supervisor, ana, monkeypatch):
    monkeypatch.setattr("telepresence_site.practice.pool.AGAIN", 0.0)
    visit(ana, Robot.objects.create(name="giraff", title="Giraff"))
    seen = set()
    for _ in range(10):
        supervisor.look()
        seen.add(process(supervisor).pid)
        session = drives(ana)
        supervisor.look()
        leaves(session)
        supervisor.look()
        assert supervisor._running == {}
    assert len(seen) == 10
    assert supervisor.children.running == []


def test_ending_a_robot_that_is_already_gone_is_no_error(supervisor, ana):
    session = drives(ana)
    supervisor.look()
    process(supervisor).kill()
    process(supervisor).wait()
    leaves(session)
    supervisor.look()
    assert supervisor._running == {}
    child = supervisor.children.start("practice-1", ["-c", "pass"])
    supervisor.children.end(child)
    supervisor.children.end(child)


def test_robot_that_died_is_named_once_with_its_reason_and_its_log(supervisor, ana, caplog):
    drives(ana)
    sentences = []
    supervisor._tell = sentences.append
    supervisor.look()
    process(supervisor).kill()
    process(supervisor).wait()
    supervisor.look()
    supervisor.look()
    (sentence,) = sentences
    ended = "The practice robot practice-1 ended: it was ended by SIGKILL (its log"
    assert sentence.startswith(ended)
    lines = [record.getMessage() for record in caplog.records]
    (line,) = [line for line in lines if line.startswith("practice_robot_died")]
    for word in ("robot=practice-1", "SIGKILL", "practice-1.log"):
        assert word in line


def test_practice_robots_are_created_once_and_disabled_when_fewer_are_wanted(practice, settings):
    robot = Robot.objects.get(name="practice-1")
    robots.prepare(2, "mqtt://127.0.0.1:1")
    robots.prepare(1, "mqtt://127.0.0.1:1")
    assert list(Robot.objects.order_by("name").values_list("name", "enabled", "practice")) == [
        ("practice-1", True, True),
        ("practice-2", False, True),
    ]
    kept = Robot.objects.get(name="practice-1").credentials.credential_hash
    assert kept == robot.credentials.credential_hash
    assert FloorPlan.objects.count() == 1


# --- where to practise ----------------------------------------------------------------------------


def test_visitor_is_sent_to_the_shortest_queue_of_an_online_robot():
    one, two = (functools.partial(PracticePlace, name) for name in NAMES)
    assert choose([]) is None
    assert choose([one(there=False, taken=0)]) is None
    assert choose([one(there=True, taken=1), two(there=False, taken=0)]) == "practice-1"
    assert choose([one(there=True, taken=2), two(there=True, taken=1)]) == "practice-2"


def test_site_offers_practice_as_soon_as_a_robot_is_online(client, practice, ana):
    assert client.get("/practice/").status_code == 302
    client.force_login(ana)
    assert client.get("/practice/").json() == {"url": None}
    RobotPresence.objects.update(connection="ONLINE", last_seen_at=timezone.now())
    assert client.get("/practice/").json() == {"url": "/practice/practice-1/?go=1"}


def test_only_a_practice_robots_page_may_be_framed_and_only_by_this_site(client, practice, ana):
    Robot.objects.create(name="giraff", title="Giraff")
    client.force_login(ana)
    framed = client.get("/practice/practice-1/")
    assert framed.headers["X-Frame-Options"] == "SAMEORIGIN"
    assert "frame-ancestors 'self'" in framed.headers["Content-Security-Policy"]
    assert client.get("/practice/giraff/").status_code == 404
    whole = client.get("/robots/giraff/")
    assert whole.headers["X-Frame-Options"] == "DENY"
    assert "frame-ancestors 'none'" in whole.headers["Content-Security-Policy"]
    assert '"practice": "/practice/"' in whole.content.decode()


def test_practice_robots_are_not_listed_and_offered_only_if_there_are_any(
    client, practice, ana, settings
):
    Robot.objects.create(name="giraff", title="Giraff")
    client.force_login(ana)
    assert [robot["name"] for robot in client.get("/robots.json").json()["robots"]] == ["giraff"]
    settings.PRACTICE_ROBOTS = 0
    assert '"practice": null' in client.get("/robots/giraff/").content.decode()
