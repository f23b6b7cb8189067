"""When data is deleted, and what remains of a deleted user."""

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
from experiments.models import Appointment, ConsentReceipt, Contact, Participant, Study, StudyMember
from experiments.participation import links
from experiments.participation.consent import agree
from experiments.participation.withdrawal import deletion
from experiments.recruitment import recognition
from experiments.recruitment.sites import Arrival
from robots.models import Robot, RobotPermit
from sessions import system_log
from sessions.models import NetworkSample, Session, SessionEvent, Snapshot, SystemLog
from surveys.questionnaires import store
from surveys.responses import Context, Respondent, begin
from tests.support.people import person
from tests.support.sessions import replays
from tests.support.studies import participants as p, questionnaires

pytestmark = pytest.mark.django_db
DAY = datetime.timedelta(days=1)
DEVICE = {"os": "Linux", "browser": "Firefox", "network": "198.51.100.0/24"}
DEVICE["user_agent"] = "Mozilla/5.0 (of a test)"


def visit(robot: Robot, name: str, days_ago: float) -> Session:
    """Store an old session with a photo, a network sample and an event."""
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
    pairs = [line.split(": ") for line in out.getvalue().splitlines()]
    return {kind: int(sentence.split()[0]) for kind, sentence in pairs}


@pytest.fixture
def robot():
    return replays.cabin_robot()


def test_each_kind_of_data_is_deleted_after_its_days(robot):
    ages = {"today": 0.5, "last_month": 40, "last_spring": 100, "last_year": 400}
    for name, days in ages.items():
        visit(robot, name, days)
    for days in (1, 100):
        system_log.log("robot_online", robot=robot, at=timezone.now() - days * DAY)
        audit.note("photo_opened", at=timezone.now() - days * 20 * DAY)
    audit.note("estop", at=timezone.now() - 2000 * DAY)
    kinds = ("sessions", "photos", "network_samples", "addresses", "system_log", "audit_log")
    kinds += ("interventions",)
    never = {"enrolments": 0, "undecided": 0, "guests": 0}
    assert forget() == {**dict.fromkeys(kinds, 1), "addresses": 2, **never}
    visitors = Session.objects.values_list("visitor__username", flat=True)
    assert set(visitors) == {"today", "last_month", "last_spring"}
    photographers = Snapshot.objects.values_list("session__visitor__username", flat=True)
    assert set(photographers) == {"today", "last_month"}
    assert SessionEvent.objects.count() == 3
    kept = Session.objects.get(visitor__username="last_month").device
    assert (kept["os"], kept["network"], kept["user_agent"]) == ("Linux", "", "")
    assert Session.objects.get(visitor__username="today").device == DEVICE
    assert forget() == {**dict.fromkeys(kinds, 0), **never}


def test_dry_run_deletes_nothing_and_deletions_are_logged(robot):
    visit(robot, "last_year", 400)
    assert forget(dry_run=True)["sessions"] == 1
    assert Session.objects.exists()
    assert not SystemLog.objects.filter(event="forgotten").exists()
    forget()
    logged = SystemLog.objects.filter(event="forgotten").values_list("fields", flat=True)
    assert {"kind": "sessions", "count": 1} in logged


def test_records_without_a_retention_limit_are_kept(robot, settings):
    settings.RETENTION_DAYS = dict.fromkeys(settings.RETENTION_DAYS, 0.0)
    visit(robot, "last_year", 4000)
    assert forget() == {"enrolments": 0, "undecided": 0, "guests": 0}
    assert Session.objects.get().device == DEVICE


def test_live_session_and_open_record_are_kept(robot):
    replays.session(robot, person("here"), granted=timezone.now() - 4000 * DAY)
    replays.session(robot, person("open"), granted=timezone.now() - 4000 * DAY, seconds=60)
    assert forget()["sessions"] == 0
    assert Session.objects.count() == 2


def test_session_of_a_study_loses_only_its_address(robot):
    row, study = visit(robot, "ada", 400), replays.study()
    replays.drive(replays.participant(study, row.visitor), row)
    names = Pseudonyms(study.secret)
    before = names.network(DEVICE["network"])
    assert forget()["sessions"] == 0
    row.refresh_from_db()
    assert (row.snapshots.count(), row.network_samples.count()) == (1, 1)
    assert row.device["network"] == before == names.network(row.device["network"])
    assert row.device["user_agent"] == ""


def test_who_never_agreed_to_the_consent_is_forgotten_after_a_day():
    study = p.published(p.of("exploration"), entry="code")
    for number, days in enumerate((0, 2, 2)):
        one = p.comer(
            study, create_guest("participant"), recruitment={"PROLIFIC_PID": f"zq{number}"}
        )
        times = {"seen_at": timezone.now() - days * DAY, "created_at": timezone.now() - days * DAY}
        Participant.objects.filter(pk=one.pk).update(**times)
        User.objects.filter(pk=one.user_id).update(date_joined=times["created_at"])
        if number == 2:
            agree(one, study.as_definition().consent, language="en", now=timezone.now())
    assert forget(dry_run=True)["undecided"] == 1
    assert Participant.objects.exclude(recruitment_id="").count() == 3
    found = forget()
    assert (found["undecided"], found["guests"], User.objects.count()) == (1, 1, 2)
    (row,) = Participant.objects.filter(user=None)
    assert (row.status, row.recruitment_id, row.recruitment) == ("active", "", {})
    assert "zq1" not in row.recruited_as
    assert recognition.known(study, Arrival("prolific", "zq1")) is None, "and may come again"
    assert forget()["undecided"] == 0


# --- accounts -------------------------------------------------------------------------------------

MARKS = ("zaphod", "Beeblebrox", "betelgeuse.example", "secret answer of mine", "recruited-as-zb")


def everything_of(user, robot: Robot) -> Participant:
    """Store something of a visitor in every table that refers to visitors."""
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
    past = {"seconds": 60, "closed_at": now, "device": DEVICE}
    row = replays.session(robot, user, granted=now - DAY, **past, outcome_reason="left")
    times = {"stamp": 1.0, "received_at": 1.0}
    SessionEvent.objects.create(
        session=row, source="page", type="said", data={"who": "Beeblebrox"}, **times
    )
    Snapshot.objects.create(session=row, action_id="p", stamp=1.0, sha256="0" * 64, jpeg=b"zaphod")
    replays.drive(one, row, settled_at=now)
    replays.session(robot, user, granted=now - 2 * DAY, **past)
    system_log.log("session_ended", session=row, who="zaphod")
    consent = {"step": "c", "version": 1, "language": "en", "text": "Yes", "agreed_at": now}
    ConsentReceipt.objects.create(participant=one, guardian="Beeblebrox senior", **consent)
    link, _token = links.make(study, label="for zaphod", now=now)
    type(link).objects.filter(pk=link.pk).update(participant=one, redeemed_at=now)
    asked = store(questionnaires.defined([questionnaires.item("text", "q1")]), now)
    context = Context(key=f"study/{one.pk}/1.0.q", return_to="/about/")
    answer = begin(asked, Respondent(user=user), context, language="en", seed=1, now=now)
    given = {"language": "en", "text_version": "", "first_at": now, "answered_at": now}
    answer.answers.create(item="q1", value="secret answer of mine", position=0, **given)
    reports.home(study).mkdir(parents=True)
    (reports.home(study) / "table.json").write_text("zaphod")
    return one


def traces(marks: tuple[str, ...]) -> list[str]:
    """Return the tables with any of these words."""
    found = []
    for model in apps.get_models():
        for row in model._base_manager.values():
            words = " ".join(
                str(bytes(value) if isinstance(value, memoryview) else value)
                for value in row.values()
            )
            found += [f"{model.__name__}: {one}" for one in marks if one.lower() in words.lower()]
    return found


def traces_of_key(key) -> list[str]:
    """Return the tables with a user's key, but for the audit log."""
    found = traces((str(key), key.hex))
    return [trace for trace in found if not trace.startswith("AuditEntry")]


def zaphod():
    return person("zaphod", display_name="Zaphod Beeblebrox", email="zaphod@betelgeuse.example")


@pytest.mark.parametrize("by", ["themselves", "an administrator"])
def test_no_data_are_left_of_a_deleted_account(robot, by):
    user = zaphod()
    one, key = everything_of(user, robot), user.pk
    tables = {trace.partition(": ")[0] for trace in traces(MARKS)}
    assert tables >= {"User", "EmailAddress", "Participant", "SystemLog", "Answer"}
    if by == "themselves":
        assert deletion.delete_everything(user, timezone.now())
    else:
        user.delete()
    assert traces(MARKS) == []
    assert traces_of_key(key) == []
    assert not reports.home(one.study).exists()
    assert not Participant.objects.filter(pk=one.pk).exists()
    shell = Participant.objects.get()
    assert (shell.status, shell.user, shell.age, shell.recruitment) == ("withdrawn", None, None, {})
    assert AuditEntry.objects.get(act="withdrawn").person is None


def test_account_without_password_is_deleted_with_its_last_study(robot):
    study = replays.study(status=Study.Status.PUBLISHED)
    left, taking_part, new = (create_guest("participant") for _ in range(3))
    replays.participant(study, taking_part)
    User.objects.exclude(pk=new.pk).update(date_joined=timezone.now() - 2 * DAY)
    assert forget()["guests"] == 1
    assert not User.objects.filter(pk=left.pk).exists()
    assert User.objects.filter(kind="participant").count() == 2
    assert forget()["guests"] == 0


def relations() -> set[str]:
    """Return all relations of tables to users."""
    user = get_user_model()
    return {
        f"{model.__name__}.{field.name}"
        for model in apps.get_models()
        for field in model._meta.get_fields()
        if getattr(field, "related_model", None) is user and field.concrete
    }


def test_every_relation_to_a_person_is_covered_by_these_tests():
    own = {
        *("EmailAddress.user", "RobotPermit.user", "Participant.user", "Session.visitor"),
        *("Response.user", "EntryCode.user"),
    }
    of_staff = {
        *("Robot.owner", "StudyMember.user", "Drive.excluded_by", "Coding.coder", "Lease.wizard"),
        *("Study.published_by", "Rehearsal.ended_by", "StudyKey.made_by", "LogEntry.user"),
        "ResearcherInvitation.invited_by",
    }
    assert relations() == own | of_staff


def test_work_of_deleted_staff_stays_without_their_name(robot):
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
    assert traces_of_key(key) == []
    drive.refresh_from_db()
    assert (drive.excluded_by, drive.excluded_reason) == (None, "fell asleep")
