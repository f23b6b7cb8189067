"""What is forgotten when, and what is left of somebody who is gone."""

import datetime
import io

import pytest
from django.apps import apps
from django.contrib.admin.models import CHANGE, LogEntry
from django.contrib.auth import get_user_model
from django.core.management import call_command
from django.utils import timezone

from accounts import audit
from accounts.models import AuditEntry, User
from accounts.passwordless import create_guest
from experiments.export import reports
from experiments.extraction.pseudonyms import Pseudonyms
from experiments.models import (
    Appointment,
    ConsentReceipt,
    Contact,
    Participant,
    Study,
    StudyMember,
)
from experiments.participation import links
from experiments.participation.withdrawal import deletion
from robots.models import Robot, RobotPermit
from sessions import system_log
from sessions.models import NetworkSample, Session, SessionEvent, Snapshot, SystemLog
from surveys.questionnaires import store
from surveys.responses import Context, Respondent, begin
from tests.support.people import person
from tests.support.sessions import replays
from tests.support.studies import questionnaires

pytestmark = pytest.mark.django_db
DAY = datetime.timedelta(days=1)
DEVICE = {
    "os": "Linux",
    "browser": "Firefox",
    "network": "198.51.100.0/24",
    "user_agent": "Mozilla/5.0 (of nobody)",
}


def visit(robot: Robot, name: str, days_ago: float) -> Session:
    """A session of so long ago with one of everything."""
    at = timezone.now() - days_ago * DAY
    row = replays.session(
        robot, person(name), granted=at, seconds=60, closed_at=at + DAY / 24, device=DEVICE
    )
    about = {"session": row, "stamp": at.timestamp()}
    Snapshot.objects.create(**about, action_id="p", sha256="0" * 64, jpeg=b"jpeg")
    NetworkSample.objects.create(**about, received_at=at.timestamp(), data={})
    SessionEvent.objects.create(
        **about, source="server", type="granted", received_at=at.timestamp(), data={}
    )
    return row


def forget(**options) -> dict[str, int]:
    out = io.StringIO()
    call_command("forget", stdout=out, **options)
    return {
        kind: int(told.split()[0])
        for kind, told in (line.split(": ") for line in out.getvalue().splitlines())
    }


@pytest.fixture
def robot():
    return replays.cabin_robot()


def test_each_kind_goes_when_its_days_are_over(robot):
    for name, days in (
        ("today", 0.5),
        ("last_month", 40),
        ("last_spring", 100),
        ("last_year", 400),
    ):
        visit(robot, name, days)
    for days in (1, 100):
        system_log.log("robot_online", robot=robot, at=timezone.now() - days * DAY)
        audit.note("photo_opened", at=timezone.now() - days * 20 * DAY)
    told = {
        "sessions": 1,
        "photos": 1,
        "network_samples": 1,
        "addresses": 2,
        "system_log": 1,
        "audit_log": 1,
    }
    assert forget() == {**told, "enrolments": 0, "guests": 0}
    assert set(Session.objects.values_list("visitor__username", flat=True)) == {
        "today",
        "last_month",
        "last_spring",
    }
    assert set(Snapshot.objects.values_list("session__visitor__username", flat=True)) == {
        "today",
        "last_month",
    }
    assert SessionEvent.objects.count() == 3
    kept = Session.objects.get(visitor__username="last_month").device
    assert (kept["os"], kept["network"], kept["user_agent"]) == ("Linux", "", "")
    assert Session.objects.get(visitor__username="today").device == DEVICE
    assert forget() == {**dict.fromkeys(told, 0), "enrolments": 0, "guests": 0}


def test_a_dry_run_counts_and_forgets_nothing_and_what_was_forgotten_is_logged(robot):
    visit(robot, "last_year", 400)
    assert forget(dry_run=True)["sessions"] == 1
    assert Session.objects.exists()
    assert not SystemLog.objects.filter(event="forgotten").exists()
    forget()
    assert {"kind": "sessions", "count": 1} in list(
        SystemLog.objects.filter(event="forgotten").values_list("fields", flat=True)
    )


def test_what_is_kept_for_ever_is_kept_for_ever(robot, settings):
    settings.RETENTION_DAYS = dict.fromkeys(settings.RETENTION_DAYS, 0.0)
    visit(robot, "last_year", 4000)
    assert forget() == {"enrolments": 0, "guests": 0}
    assert Session.objects.get().device == DEVICE


def test_a_living_session_and_an_open_record_are_left_alone(robot):
    replays.session(robot, person("here"), granted=timezone.now() - 4000 * DAY)
    replays.session(robot, person("open"), granted=timezone.now() - 4000 * DAY, seconds=60)
    assert forget()["sessions"] == 0
    assert Session.objects.count() == 2


def test_of_a_studys_session_only_the_address_goes_and_its_network_is_still_counted(robot):
    row, study = visit(robot, "ada", 400), replays.study()
    replays.drive(replays.participant(study, row.visitor), row)
    names = Pseudonyms(study.secret)
    before = names.network(DEVICE["network"])
    assert forget()["sessions"] == 0
    row.refresh_from_db()
    assert (row.snapshots.count(), row.network_samples.count()) == (1, 1)
    assert row.device["network"] == before == names.network(row.device["network"])
    assert row.device["user_agent"] == ""


# --- accounts -------------------------------------------------------------------------------------

MARKS = ("zaphod", "Beeblebrox", "betelgeuse.example", "secret answer of mine", "recruited-as-zb")


def everything_of(user, robot: Robot) -> Participant:
    """Leave something of a visitor in every place that knows visitors."""
    from allauth.account.models import EmailAddress

    EmailAddress.objects.create(user=user, email=user.email)
    RobotPermit.objects.create(robot=robot, user=user, kind="invited")
    study = replays.study(status=Study.Status.PUBLISHED)
    one = replays.participant(study, user, recruitment={"PROLIFIC_PID": "recruited-as-zb"}, age=42)
    now = timezone.now()
    Participant.objects.filter(pk=one.pk).update(recruitment_id="recruited-as-zb")
    Contact.objects.create(
        participant=one, email="zaphod@betelgeuse.example", site="https://x/", given_at=now
    )
    Appointment.objects.create(
        participant=one, robot=robot, visit=1, starts_at=now, ends_at=now + DAY, slot="zaphod"
    )
    row = replays.session(
        robot,
        user,
        granted=now - DAY,
        seconds=60,
        closed_at=now,
        device=DEVICE,
        outcome_reason="left",
    )
    SessionEvent.objects.create(
        session=row,
        source="page",
        type="said",
        stamp=1.0,
        received_at=1.0,
        data={"who": "Beeblebrox"},
    )
    Snapshot.objects.create(session=row, action_id="p", stamp=1.0, sha256="0" * 64, jpeg=b"zaphod")
    replays.drive(one, row, settled_at=now)
    replays.session(robot, user, granted=now - 2 * DAY, seconds=60, closed_at=now, device=DEVICE)
    system_log.log("session_ended", session=row, who="zaphod")
    ConsentReceipt.objects.create(
        participant=one,
        step="c",
        version=1,
        language="en",
        text="Yes",
        guardian="Beeblebrox senior",
        agreed_at=now,
    )
    link, _token = links.make(study, label="for zaphod", now=now)
    type(link).objects.filter(pk=link.pk).update(participant=one, redeemed_at=now)
    asked = store(questionnaires.defined([questionnaires.item("text", "q1")]), now)
    context = Context(key=f"study/{one.pk}/1.0.q", return_to="/about/")
    answer = begin(asked, Respondent(user=user), context, language="en", seed=1, now=now)
    answer.answers.create(
        item="q1",
        value="secret answer of mine",
        language="en",
        text_version="",
        position=0,
        first_at=now,
        answered_at=now,
    )
    reports.home(study).mkdir(parents=True)
    (reports.home(study) / "table.json").write_text("zaphod")
    return one


def traces(marks: tuple[str, ...]) -> list[str]:
    """Return where any of these words stands in any row of any table."""
    found = []
    for model in apps.get_models():
        for row in model._base_manager.values():
            words = " ".join(
                str(bytes(value) if isinstance(value, memoryview) else value)
                for value in row.values()
            )
            found += [
                f"{model.__name__}: {mark}" for mark in marks if mark.lower() in words.lower()
            ]
    return found


def zaphod():
    return person("zaphod", display_name="Zaphod Beeblebrox", email="zaphod@betelgeuse.example")


@pytest.mark.parametrize("by", ["themselves", "an administrator"])
def test_nothing_is_left_of_whoever_deletes_their_account_or_is_deleted(robot, by):
    user = zaphod()
    one, key = everything_of(user, robot), user.pk
    assert {trace.partition(": ")[0] for trace in traces(MARKS)} >= {
        "User",
        "EmailAddress",
        "Participant",
        "SystemLog",
        "Answer",
    }
    if by == "themselves":
        assert deletion.delete_everything(user, timezone.now())
    else:
        user.delete()
    assert traces(MARKS) == []
    left = [trace for trace in traces((str(key), key.hex)) if not trace.startswith("AuditEntry")]
    assert left == []
    assert not reports.home(one.study).exists()
    assert not Participant.objects.filter(pk=one.pk).exists()
    shell = Participant.objects.get()
    assert (shell.status, shell.user, shell.age, shell.recruitment) == ("withdrawn", None, None, {})
    assert AuditEntry.objects.get(act="withdrawn").person is None


def test_a_participants_account_without_password_goes_when_it_has_no_study_any_more(robot):
    study = replays.study(status=Study.Status.PUBLISHED)
    left, taking_part, new = (create_guest("participant") for _ in range(3))
    replays.participant(study, taking_part)
    User.objects.exclude(pk=new.pk).update(date_joined=timezone.now() - 2 * DAY)
    assert forget()["guests"] == 1
    assert not User.objects.filter(pk=left.pk).exists()
    assert User.objects.filter(kind="participant").count() == 2
    assert forget()["guests"] == 0


def relations() -> set[str]:
    """Return every way from a table to a user."""
    user = get_user_model()
    return {
        f"{model.__name__}.{field.name}"
        for model in apps.get_models()
        for field in model._meta.get_fields()
        if getattr(field, "related_model", None) is user and field.concrete
    }


def test_every_relation_to_a_person_is_one_that_these_tests_know():
    own = {
        "EmailAddress.user",
        "RobotPermit.user",
        "Participant.user",
        "Session.visitor",
        "Response.user",
        "EntryCode.user",
    }
    of_staff = {
        "Robot.owner",
        "StudyMember.user",
        "Drive.excluded_by",
        "Coding.coder",
        "Lease.wizard",
        "Study.published_by",
        "Rehearsal.ended_by",
        "StudyKey.made_by",
        "ResearcherInvitation.invited_by",
        "LogEntry.user",
    }
    assert relations() == own | of_staff


def test_of_staff_who_are_deleted_their_work_stays_without_their_name(robot):
    user = zaphod()
    Robot.objects.update(owner=user)
    StudyMember.objects.create(slug="cabin-study", user=user, role="owner")
    study = replays.study(status=Study.Status.PUBLISHED, published_by=user)
    visitor = person("ada")
    drive = replays.drive(
        replays.participant(study, visitor), replays.session(robot, visitor, seconds=60)
    )
    type(drive).objects.update(excluded_by=user, excluded_reason="fell asleep")
    LogEntry.objects.log_actions(user.pk, [robot], CHANGE, "Moved.", single_object=True)
    key = user.pk
    user.delete()
    assert traces(MARKS) == []
    assert [
        trace for trace in traces((str(key), key.hex)) if not trace.startswith("AuditEntry")
    ] == []
    drive.refresh_from_db()
    assert (drive.excluded_by, drive.excluded_reason) == (None, "fell asleep")
