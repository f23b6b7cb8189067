"""Robots to which the session manager sends heartbeats, and the queries that the others need."""

import datetime

import pytest
from django.utils import timezone

from accounts.models import User
from robots.models import Robot, RobotPresence
from sessions.manager.desired_state import READ_ALL_SECONDS, DesiredState
from sessions.manager.scheduler import needed_robots
from sessions.models import Session
from tests.support.sessions.rows import session_row

pytestmark = pytest.mark.django_db


def robots(*names):
    return [Robot.objects.create(name=name, title=name) for name in names]


def session(robot, state, **fields):
    visitor = User.objects.get_or_create(username="ana")[0]
    return session_row(robot, visitor, state=state, **fields)


def test_robots_that_are_driven_awaited_recorded_or_returning_are_needed(
    django_assert_num_queries,
):
    driving, waited, recorded, over, away, _idle = robots(
        "driven", "waited", "recorded", "over", "away", "idle"
    )
    now = timezone.now()
    session(driving, Session.State.DRIVING)
    session(waited, Session.State.WAITING)
    session(recorded, Session.State.ENDED)
    session(over, Session.State.ENDED, closed_at=now)
    RobotPresence.objects.filter(pk=away.pk).update(turnaround=Robot.Turnaround.RETURNING)
    with django_assert_num_queries(1):
        assert needed_robots() == {"driven", "waited", "recorded", "away"}
    Robot.objects.update(enabled=False)
    assert needed_robots() == frozenset()


def test_settings_of_many_robots_need_as_many_queries_as_of_few(
    django_assert_max_num_queries,
):
    robots(*(f"robot-{number}" for number in range(30)))
    desired, now = DesiredState(), timezone.now()
    later = now + datetime.timedelta(seconds=READ_ALL_SECONDS)
    with django_assert_max_num_queries(4):
        assert len(list(desired.tick(now))) == 30
    with django_assert_max_num_queries(3):
        assert list(desired.tick(later)) == []
    Robot.objects.filter(name="robot-7").update(assist="slow")
    (message,) = desired.tick(later + (later - now))
    assert message.topic.endswith("/robot-7/config")
