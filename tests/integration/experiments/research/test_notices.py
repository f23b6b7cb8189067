"""Researchers get a mail when a robot of their study cannot go on."""

import pytest
from django.core import mail
from django.utils import timezone

from experiments import signal_handlers
from experiments.models import StudyMember
from robots.api import messages as m
from robots.models import Robot, RobotPresence
from sessions import signals
from sessions.manager.return_to_dock import ReturnToDock
from sessions.manager.robot_liveness import RobotLiveness
from sessions.models import Session, SystemLog
from tests.support import words
from tests.support.people import person
from tests.support.studies import participants as p
from tests.support.studies.studies import small_study
from tests.support.studies.task_session import cabin_robot

pytestmark = pytest.mark.django_db
NOW = timezone.now()


@pytest.fixture
def study():
    cabin_robot()
    study = p.published(small_study())
    for name, role in (("olga", "owner"), ("rita", "researcher"), ("vera", "viewer")):
        StudyMember.objects.create(
            slug=study.slug, user=person(name, email=f"{name}@example.org"), role=role
        )
    return study


def pauses(return_to_dock: ReturnToDock, seq: int) -> None:
    """The robot's emergency stop is on while it should go home."""
    RobotPresence.objects.update(turnaround="returning", turnaround_reason="dock")
    liveness = RobotLiveness()
    liveness.take(words.state(seq, safety=m.Safety(estop=True)), NOW.timestamp())
    list(return_to_dock.tick({"giraff": liveness}, NOW, NOW.timestamp()))


def test_owners_and_researchers_get_one_mail_for_each_pause(study):
    return_to_dock = ReturnToDock()
    pauses(return_to_dock, 1)
    RobotPresence.objects.update(turnaround="paused")
    list(return_to_dock.tick({}, NOW, NOW.timestamp()))
    list(return_to_dock.tick({}, NOW, NOW.timestamp()))
    assert [(message.bcc, message.to) for message in mail.outbox] == [
        (["olga@example.org", "rita@example.org"], [])
    ]
    assert "its emergency stop is on" in mail.outbox[0].body
    assert "Giraff" in mail.outbox[0].subject
    assert SystemLog.objects.get(event="queue_paused").fields == {"reason": "estop"}
    pauses(return_to_dock, 2)
    assert len(mail.outbox) == 2


def test_closed_studies_and_those_with_another_robot_get_no_mail(study):
    study.status = "closed"
    study.save()
    pauses(ReturnToDock(), 1)
    study.status = "published"
    study.save()
    RobotPresence.objects.update(factsheet={"series": "rhodon", "capabilities": ["dock"]})
    pauses(ReturnToDock(), 2)
    assert mail.outbox == []


def test_an_unreachable_mail_server_does_not_stop_the_manager(study, settings, caplog):
    settings.EMAIL_BACKEND = "django.core.mail.backends.smtp.EmailBackend"
    settings.EMAIL_HOST, settings.EMAIL_PORT = "127.0.0.1", 1
    pauses(ReturnToDock(), 1)
    assert Robot.objects.get().presence.turnaround == "paused"
    assert any(record.message.startswith("staff_not_notified") for record in caplog.records)


def test_each_signal_has_one_receiver_however_often_it_is_connected():
    before = len(signals.state_received.receivers)
    signal_handlers.connect()
    assert len(signals.state_received.receivers) == before
    assert signals.message_received.has_listeners(Session)
