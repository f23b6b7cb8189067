"""A drive of a study begins at its station: until the robot is there, the participant waits and
researchers get an e-mail.
"""

import datetime
from typing import Any

import pytest
from django.core import mail

from accounts.models import User
from experiments.models import Drive, StudyMember
from experiments.research.live import now_in
from experiments.tasks.finalization import settle
from experiments.tasks.records import FirstFrame
from robots.api import topics
from robots.models import Robot, RobotPresence
from sessions import protocol
from sessions.leases import store
from sessions.leases.transitions import RobotLink
from sessions.manager.scheduler import Scheduler
from sessions.models import Session, SessionEvent
from tests.support.agents.docked_robot import report_in_dock
from tests.support.studies import participants as p
from tests.support.studies.studies import small_study
from tests.support.studies.task_drives import BACK, THERE, Drive as DriveRecord
from tests.support.studies.task_session import begin, cabin_robot, close, small_conditions, write

pytestmark = pytest.mark.django_db
NOW = datetime.datetime.now(datetime.UTC)


def later(seconds: float) -> datetime.datetime:
    return NOW + datetime.timedelta(seconds=seconds)


@pytest.fixture
def robot():
    found = cabin_robot()
    Robot.objects.update(returns_home=False)
    return found


@pytest.fixture
def study():
    found = p.published(small_study(conditions=[small_conditions()[0]], start={"charge": 0.3}))
    researcher = User.objects.create(username="rae", email="rae@example.org")
    StudyMember.objects.create(slug=found.slug, user=researcher, role=StudyMember.Role.RESEARCHER)
    return found


def stands(robot: Robot, **changes: Any) -> None:
    RobotPresence.objects.filter(pk=robot.pk).update(
        report=report_in_dock(robot.floor_plan, "giraff", **changes)
    )


def stands_away(robot: Robot) -> None:
    stands(robot, docked=False, chargerContact=False, pose={"x": 1.5, "y": 2.0, "theta": 0.0})


def ask(robot: Robot, user: User, at: datetime.datetime) -> store.Taken:
    return store.take(Robot.objects.get(pk=robot.pk), user, f"peer-{user.username}", now=at)


def looks(keeper: Scheduler, *seconds: float) -> list[tuple[type, str]]:
    """Let a session manager tick at these times; return the notices to pages: kind and reason."""
    for second in seconds:
        for session in Session.objects.filter(state="waiting"):
            store.seen({str(session.pk)}, later(second))
        link = RobotLink(since=0.0, last_received_at=later(second).timestamp())
        keeper.tick({"giraff": link}, RobotLink(since=0.0), later(second))
    prefix = topics.session_notices("")
    sent = [one.payload.decode() for one in keeper.outbox if one.topic.startswith(prefix)]
    keeper.outbox.clear()
    notices = map(protocol.decode_notice, sent)
    return [(type(notice), getattr(notice, "reason", "")) for notice in notices]


def noted(session: str) -> list[str]:
    types = ("robot_not_ready", "robot_ready", "staff_called", "offered")
    rows = SessionEvent.objects.filter(session=session, type__in=types).order_by("stamp")
    return list(rows.values_list("type", flat=True))


def first_time_user(study: Any, name: str) -> User:
    user = User.objects.create(username=name)
    p.comer(study, user)
    return user


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"docked": False}, "not_docked"),
        ({"pose": {"x": 0.5, "y": 2.0, "theta": 3.14159, "localized": False}}, "lost"),
        ({"pose": {"x": 1.0, "y": 2.0, "theta": 3.14159}}, "elsewhere"),
        ({"battery": {"charge": 0.2}}, "charge"),
        ({"boot": "of-yesterday"}, "silent"),
    ],
)
def test_a_participant_waits_and_gets_the_reason(robot, study, changes, reason):
    stands(robot, **changes)
    taken = ask(robot, first_time_user(study, "ada"), NOW)
    assert isinstance(taken, store.Queued)
    assert (taken.place, taken.reason) == (1, f"start: {reason}")
    assert not Drive.objects.exists()


def test_the_second_participant_does_not_begin_where_the_first_ended(robot, study):
    first = begin(robot, "ada", study)
    stands_away(robot)
    store.end(str(first.session_id), "cancelled", "left", NOW)
    ben = first_time_user(study, "ben")
    taken = ask(robot, ben, NOW)
    assert isinstance(taken, store.Queued)

    notices = looks(Scheduler(), 0.5, 1.0, 3.0)
    assert (protocol.Queued, "start: not_docked") in notices
    assert mail.outbox == []
    second = Scheduler()  # the session manager was killed, and another one started
    looks(second, 4.0, 10.0, 11.0, 60.0)
    assert [message.to + message.bcc for message in mail.outbox] == [["rae@example.org"]]
    assert "it is not docked" in mail.outbox[0].body
    looks(Scheduler(), 61.0, 70.0, 80.0)  # and a third one
    assert len(mail.outbox) == 1
    assert isinstance(ask(robot, ben, later(81.0)), store.Queued), "the page was reloaded"
    assert now_in(study.slug, later(81.0))["robots"][0]["unready"] == "it is not docked"

    stands(robot)  # it was put back
    assert protocol.Offered in [kind for kind, _ in looks(second, 82.0)]
    assert noted(taken.session)[-2:] == ["offered", "robot_ready"]
    granted = ask(robot, ben, later(83.0))
    assert isinstance(granted, store.TakeGranted)
    assert Drive.objects.get(session=granted.session).assigned["start"]["charge"] == 0.3


def test_the_same_happens_a_second_time(robot, study):
    for number, name in enumerate(("ada", "ben", "eve")):
        at = later(1000.0 * number)
        stands_away(robot)
        user = first_time_user(study, name)
        assert isinstance(ask(robot, user, at), store.Queued)
        looks(Scheduler(), 1000.0 * number + 1.0)
        stands(robot)
        looks(Scheduler(), 1000.0 * number + 2.0)
        granted = ask(robot, user, later(1000.0 * number + 3.0))
        assert isinstance(granted, store.TakeGranted)
        store.end(granted.session, "cancelled", "left", later(1000.0 * number + 4.0))


def test_a_robot_carried_away_during_an_offer_is_offered_again_at_its_station(robot, study):
    stands_away(robot)
    ada = first_time_user(study, "ada")
    waiting = ask(robot, ada, NOW)
    keeper = Scheduler()
    looks(keeper, 1.0)
    stands(robot)
    looks(keeper, 2.0)
    assert Session.objects.get(pk=waiting.session).offered_at is not None
    stands_away(robot)
    looks(keeper, 3.0)
    assert Session.objects.get(pk=waiting.session).offered_at is None
    assert isinstance(ask(robot, ada, later(4.0)), store.Queued)
    looks(keeper, 60.0, 120.0)
    assert Session.objects.get(pk=waiting.session).state == "waiting"
    stands(robot)
    assert isinstance(ask(robot, ada, later(121.0)), store.TakeGranted)


def test_an_operator_passes_who_waits_and_drives_the_robot_home(robot, study):
    stands_away(robot)
    ada = first_time_user(study, "ada")
    staff = User.objects.create(username="staff", is_staff=True, is_superuser=True)
    other = User.objects.create(username="other")
    waiting = ask(robot, ada, NOW)
    looks(Scheduler(), 1.0)
    assert isinstance(ask(robot, other, later(2.0)), store.Queued), "they may not operate it"
    granted = ask(robot, staff, later(3.0))
    assert isinstance(granted, store.TakeGranted)
    stands(robot)
    store.end(granted.session, "completed", "left", later(30.0))
    looks(Scheduler(), 31.0)
    assert Session.objects.get(pk=waiting.session).offered_at is not None
    assert isinstance(ask(robot, ada, later(32.0)), store.TakeGranted)


def test_robot_that_can_return_by_itself_is_sent_home_without_an_e_mail(robot, study):
    Robot.objects.update(returns_home=True)
    stands_away(robot)
    ask(robot, first_time_user(study, "ada"), NOW)
    looks(Scheduler(), 1.0, 20.0, 30.0)
    assert Robot.objects.get().presence.turnaround == "returning"
    assert mail.outbox == []


def test_drives_outside_of_a_study_need_not_begin_at_the_station(robot, study):
    stands_away(robot)
    assert isinstance(ask(robot, User.objects.create(username="stranger"), NOW), store.TakeGranted)


def test_the_record_keeps_what_a_drive_began_from_and_ended_with(robot):
    drive = begin(robot)
    record = DriveRecord(at=NOW.timestamp(), frame=False)
    record.say(FirstFrame(record.at, repr(record.at))).go(*THERE, *BACK).touch(0.5).go((1.5, 2.0))
    write(drive, record.records)
    drive = close(drive, outcome="cancelled", reason="left", at=record.at)
    settle(drive, later(500.0))
    drive.refresh_from_db()
    place = {"x": 0.5, "y": 2.0, "theta": pytest.approx(3.14159, abs=1e-4)}
    assert drive.began_with == {"docked": True, "charge": 1.0, **place}
    assert (drive.ended_with["docked"], drive.ended_with["x"]) == (False, 1.5)
    assert drive.result["dock_contacts"] == 1
