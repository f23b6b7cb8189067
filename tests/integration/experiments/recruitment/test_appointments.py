import datetime
import re

import pytest
from django.core import mail
from django.core.mail.backends.locmem import EmailBackend
from django.core.management import CommandError, call_command
from django.test import Client
from django.utils import timezone

from experiments.models import Appointment, Contact, Participant
from experiments.participation import progress
from experiments.participation.grants import StudyTerms
from experiments.participation.own_data.gathering import gather
from experiments.recruitment import appointments, reminders
from tests.support.browsers.html_page import faults, read
from tests.support.people import person
from tests.support.studies import participants as p
from tests.support.studies.study_walk import Walker

pytestmark = pytest.mark.django_db
URL = "/studies/exploration/appointment/"
HOUR = datetime.timedelta(hours=1)


@pytest.fixture
def robot():
    return p.site()


@pytest.fixture
def walk(robot):
    def start(name: str = "ada", **asked) -> Walker:
        study = p.Study.objects.filter(slug="exploration").first() or p.published(
            p.of("exploration", appointments=asked), time_zone="Europe/Madrid"
        )
        walker = Walker(study, person(name), robot)
        walker.come()
        while walker.participant.step != "task":
            walker.do()
        return walker

    return start


def offered(page) -> list[str]:
    return [
        one.attributes["value"] for one in page.all("button") if one.attributes.get("name") == "at"
    ]


def book(walker: Walker, at: str | None = None, **fields: str):
    at = at or offered(read(walker.client.get(URL)))[0]
    return walker.client.post(URL, {"at": at, **fields})


def move(walker: Walker, start: datetime.timedelta) -> None:
    """Make the appointment begin so long from now."""
    at = timezone.now() + start
    Appointment.objects.filter(participant=walker.participant).update(
        starts_at=at, ends_at=at + HOUR / 2
    )


def test_a_required_appointment_is_needed_to_drive(walk):
    walker = walk()
    page = walker.look()
    assert faults(page) == []
    assert "Choose a time" in page.text
    assert "Go to the robot" not in page.text
    assert walker.client.get(walker.url("study_drive")).url == walker.url()
    assert book(walker).url == walker.url()
    move(walker, 3 * HOUR)
    page = walker.look()
    assert "Your appointment is on" in page.text
    assert "Go to the robot" not in page.text
    move(walker, datetime.timedelta(minutes=-5))
    assert "Go to the robot" in walker.look().text
    assert walker.client.get(walker.url("study_drive")).status_code == 200
    move(walker, datetime.timedelta(hours=-2))
    assert "Go to the robot" not in walker.look().text


def test_the_robot_itself_is_granted_only_at_the_appointment(walk, robot):
    walker = walk()
    why_not = StudyTerms().why_not
    assert why_not(walker.user, robot, timezone.now()) == "closed"
    book(walker)
    move(walker, datetime.timedelta(minutes=-5))
    assert why_not(walker.user, robot, timezone.now()) == ""
    move(walker, 3 * HOUR)
    assert why_not(walker.user, robot, timezone.now()) == "closed"


def test_an_optional_appointment_is_not_needed_to_drive(walk):
    walker = walk(required=False)
    page = walker.look()
    assert "Choose a time" in page.text
    assert "Go to the robot" in page.text


def test_a_robot_takes_one_participant_at_a_time(walk):
    ada, bob = walk(), walk("bob")
    at = offered(read(ada.client.get(URL)))[0]
    book(ada, at)
    assert at not in offered(read(bob.client.get(URL)))
    answer = book(bob, at)
    assert answer.status_code == 422
    assert "no longer free" in read(answer).text
    assert Appointment.objects.count() == 1


def test_of_two_who_take_a_slot_at_once_one_gets_it(walk, robot, monkeypatch):
    ada, bob = walk(), walk("bob")
    slot = appointments.times(ada.study, ada.study.as_definition().appointments, timezone.now())[0]
    monkeypatch.setattr(appointments, "free", lambda *_: [slot])
    real = Appointment.objects.filter
    monkeypatch.setattr(
        Appointment.objects,
        "filter",
        lambda **asked: real(**asked) if "participant" in asked else real(pk=None),
    )
    now = timezone.now()
    assert appointments.book(ada.participant, [robot], slot.starts_at, now) is not None
    assert appointments.book(bob.participant, [robot], slot.starts_at, now) is None


def test_another_time_replaces_the_first_and_can_be_cancelled(walk):
    walker = walk()
    later = {"day": f"{timezone.now() + datetime.timedelta(days=3):%Y-%m-%d}"}
    first, second = offered(read(walker.client.get(URL, later)))[:2]
    book(walker, first)
    book(walker, second)
    row = Appointment.objects.get()
    assert row.starts_at == datetime.datetime.fromisoformat(second)
    walker.client.post(URL, {"cancel": "1"})
    assert not Appointment.objects.exists()


@pytest.mark.parametrize(
    "at", ["", "yesterday", "2020-01-01T00:00:00+00:00", "2030-01-01T00:00:00"]
)
def test_a_time_that_is_none_of_the_studys_is_refused(walk, at):
    walker = walk()
    assert walker.client.post(URL, {"at": at}).status_code == 422
    assert not Appointment.objects.exists()


def test_slots_lie_in_the_opening_hours_of_the_studys_time_zone(walk):
    walker = walk(minutes=60, days_ahead=7)
    p.Study.objects.update(
        opening_hours=[{"days": [0, 1, 2, 3, 4, 5, 6], "start": "09:00", "end": "11:30"}]
    )
    study = p.Study.objects.get()
    now = datetime.datetime(2026, 3, 27, 12, tzinfo=datetime.UTC)  # the clocks change on the 29th
    found = appointments.times(study, study.as_definition().appointments, now)
    starts = {f"{one.starts_at:%d %H}" for one in found}
    assert {"28 08", "28 09", "29 07", "29 08"} <= starts
    assert all(f"{day} 10" not in starts for day in (28, 29))
    assert walker.participant.step == "task"


# --- e-mails --------------------------------------------------------------------------------------


def sent_to(walker: Walker) -> list:
    return [one for one in mail.outbox if one.to == [f"{walker.user.username}@example.org"]]


def with_address(walker: Walker) -> Walker:
    book(walker, email=f"{walker.user.username}@example.org")
    return walker


def test_a_reminder_is_sent_once_when_it_is_due(walk):
    walker = with_address(walk(reminder_hours=2))
    move(walker, 3 * HOUR)
    assert reminders.send_due(timezone.now()) == 0
    move(walker, HOUR)
    assert reminders.send_due(timezone.now()) == 1
    assert reminders.send_due(timezone.now()) == 0
    message = sent_to(walker)[0]
    assert "Explore an office with a robot" in message.subject
    assert "Europe/Madrid" in message.body
    assert "http://testserver/studies/exploration/" in message.body


def test_a_reminder_that_could_not_be_sent_is_tried_again(walk, monkeypatch):
    walker = with_address(walk(reminder_hours=2))
    move(walker, HOUR)

    def fails(*_args):
        raise ConnectionRefusedError

    with monkeypatch.context() as broken:
        broken.setattr(EmailBackend, "send_messages", fails)
        assert reminders.send_due(timezone.now()) == 0
    assert reminders.send_due(timezone.now()) == 1
    assert len(sent_to(walker)) == 1


def test_the_link_of_an_e_mail_deletes_the_address_by_post_alone(walk):
    walker = with_address(walk(reminder_hours=2))
    move(walker, HOUR)
    reminders.send_due(timezone.now())
    link = re.search(r"http://testserver(/taking-part/reminders/\S+)", mail.outbox[0].body)[1]
    assert f"<http://testserver{link}>" == mail.outbox[0].extra_headers["List-Unsubscribe"]
    stranger = Client(enforce_csrf_checks=True)
    assert faults(read(stranger.get(link))) == []
    assert Contact.objects.count() == 1, "a mail scanner opens every address"
    assert "was deleted" in read(stranger.post(link)).text
    assert not Contact.objects.exists()
    assert stranger.post(link).status_code == 200, "twice does no harm"


def test_a_finished_participant_is_invited_once_and_the_address_is_deleted(walk):
    walker = with_address(walk(required=False, second_after_days=7))
    while walker.participant.step != "thanks":
        walker.do()
    now = timezone.now()
    move(walker, -3 * HOUR)
    assert reminders.send_due(now + datetime.timedelta(days=6)) == 0
    assert Contact.objects.exists()
    assert reminders.send_due(now + datetime.timedelta(days=7, minutes=1)) == 1
    assert "second session" in sent_to(walker)[0].body
    assert not Contact.objects.exists()


def test_an_address_is_deleted_when_nothing_is_due_any_more(walk):
    walker = with_address(walk())
    move(walker, -2 * HOUR)
    Participant.objects.update(status="finished")
    reminders.clear(timezone.now())
    assert not Contact.objects.exists()
    assert Appointment.objects.filter(participant=walker.participant).exists()


def test_a_withdrawal_deletes_the_address_and_stops_e_mails(walk):
    walker = with_address(walk(reminder_hours=2))
    move(walker, HOUR)
    walker.client.post(f"/taking-part/{walker.participant.code}/withdraw/")
    assert reminders.send_due(timezone.now()) == 0
    assert not Contact.objects.exists()
    assert not Appointment.objects.exists()


def test_participants_find_address_and_appointment_in_their_own_data(walk):
    walker = with_address(walk())
    found = gather(walker.user)["studies"][0]
    assert found["reminders"]["email"] == "ada@example.org"
    assert found["appointments"][0]["visit"] == 1


@pytest.mark.parametrize("address", ["nobody", "a@b\nBcc: x@y.z", "a@example.org,b@example.org"])
def test_only_one_plain_address_is_taken(walk, address):
    walker = walk()
    assert book(walker, email=address).status_code == 422
    assert not Contact.objects.exists()


def test_the_command_sends_what_is_due_and_refuses_to_hurry(walk, capsys):
    walker = with_address(walk(reminder_hours=2))
    move(walker, HOUR)
    call_command("send_reminders")
    assert "1 e-mails sent" in capsys.readouterr().out
    with pytest.raises(CommandError, match="10 seconds"):
        call_command("send_reminders", every=1.0)
    assert progress.step_of(walker.participant).key == "task"
