"""A participant does the whole study of the paper; researchers look at the data and export it; then
the participant withdraws: which data is left, and what the receipt lists.
"""

import datetime
import hashlib
import io
import logging
from pathlib import Path

import pytest
from django.conf import settings as site_settings
from django.core.management import call_command
from django.db import connection
from django.test import Client
from django.urls import reverse
from django.utils import timezone

from accounts.models import AuditEntry, User
from experiments.export import reports
from experiments.export.archive import unpacked
from experiments.export.files import export_files
from experiments.export.formats import ON_REQUEST
from experiments.extraction.selection import Selection
from experiments.models import Drive, Participant, Study, StudyMember, TaskEvent
from experiments.participation import links
from experiments.participation.grants import StudyTerms
from sessions import system_log
from sessions.models import NetworkSample, Session, SessionEvent, Snapshot, StateChunk
from surveys.models import Answer, Response
from telepresence_site.ops.log_lines import key_value_lines
from tests.support.media.jpegs import with_metadata
from tests.support.people import person
from tests.support.sessions import replays
from tests.support.studies import own_traces, participants as p
from tests.support.studies.own_traces import in_bytes, in_files, in_tables, rows_of, values_of
from tests.support.studies.study_walk import Walker

pytestmark = [pytest.mark.django_db, pytest.mark.long]
BEGAN = datetime.datetime(2025, 3, 4, 10, 0, tzinfo=datetime.UTC)
SAID = "zqanswerofmine"
CAME_WITH = {"PROLIFIC_PID": "zqrecruited77"}


class Lines(logging.Handler):
    """Keeps what this site's log says."""

    def __init__(self) -> None:
        super().__init__(logging.DEBUG)
        self.setFormatter(key_value_lines())
        self.text = ""

    def emit(self, record: logging.LogRecord) -> None:
        self.text += self.format(record) + "\n"


@pytest.fixture
def log():
    lines, root = Lines(), logging.getLogger()
    level = root.level
    root.addHandler(lines)
    root.setLevel(logging.DEBUG)
    logging.getLogger("django.db").setLevel(logging.INFO)
    yield lines
    root.removeHandler(lines)
    root.setLevel(level)


def walker_of(study: Study, kind: str) -> Walker:
    """A participant who came by a link of a recruiting site, with an account or without one."""
    robot, front = p.site(), reverse("study", args=[study.slug])
    if kind == "full":
        names = {"email": "zqzaphod@example.org", "display_name": "Zqbeeblebrox"}
        walker = Walker(study, person("zqzaphodbb", **names), robot)
        walker.client.get(front, CAME_WITH)
        walker.come()
        return walker
    browser = Client()
    browser.get(front, CAME_WITH)
    browser.post(front)
    walker = Walker(study, User.objects.get(kind="participant"), robot)
    walker.client = browser
    return walker


def walked(kind: str) -> Walker:
    """A participant on the last page, after a drive that left one of everything."""
    walker = walker_of(p.published(p.of("exploration"), entry=Study.Entry.CODE), kind)
    while walker.step.kind != "task":
        walker.do()
    drive(walker)
    walker.look()
    answer(walker.study)
    link, _token = links.make(walker.study, label="for Zqlabelled", now=timezone.now())
    type(link).objects.filter(pk=link.pk).update(
        participant=walker.participant, redeemed_at=timezone.now()
    )
    return walker


def drive(walker: Walker) -> None:
    """As the session manager leaves it: assigned by the study's rule, recorded, and settled."""
    session = p.session_of(walker.robot, walker.participant, outcome="completed", moved=True)
    assert StudyTerms().granted(session, timezone.now()) is not None
    about = {"session": session, "stamp": BEGAN.timestamp() + 7.5}
    jpeg = with_metadata(b"zqphotographed")
    digest = hashlib.sha256(jpeg).hexdigest()
    Snapshot.objects.create(**about, action_id="zqactionid", sha256=digest, jpeg=jpeg)
    received = {**about, "received_at": BEGAN.timestamp() + 8.25}
    NetworkSample.objects.create(**received, data={"rtt": 0.1})
    SessionEvent.objects.create(
        **received, source="page", type="said", data={"words": "zqtoldthem"}
    )
    states = [replays.state(n / 4, BEGAN.timestamp(), n) for n in range(4)]
    stamps = [one["stamp"] for one in states]
    StateChunk.objects.create(
        session=session, boot="zqbootedonce", first_seq=0, last_seq=3, count=4,
        first_stamp=stamps[0], last_stamp=stamps[-1], received_at=stamps[-1], clock_offset=2.0,
        states=states,
    )  # fmt: skip
    system_log.log("session_ended", session=session, outcome="completed")
    Session.objects.filter(pk=session.pk).update(
        device={"network": "198.51.100.0/24", "user_agent": "Zqbrowser 1.0"},
        driving_at=timezone.now(), offered_at=timezone.now(), seen_at=timezone.now(),
    )  # fmt: skip
    row = Drive.objects.get(session=session)
    TaskEvent.objects.create(drive=row, number=0, stamp=BEGAN.timestamp() + 9.5, type="began")
    Drive.objects.filter(pk=row.pk).update(
        outcome="completed",
        moved=True,
        exposed_at=timezone.now(),
        settled_at=timezone.now(),
        result={"note": "zqresulted"},
    )


def answer(study: Study) -> None:
    for row in Response.objects.filter(asked_at__participant__study=study):
        Answer.objects.create(
            response=row, item="zqitem1234", value=SAID, language="en", text_version="",
            position=0, first_at=timezone.now(), answered_at=timezone.now(),
        )  # fmt: skip


def looked_at(walker: Walker) -> Client:
    """A researcher opens everything, excludes the drive, and takes a dataset."""
    boss = person("boss", is_staff=True, is_superuser=True)
    StudyMember.objects.create(slug=walker.study.slug, user=boss, role="owner")
    client, one = Client(), walker.participant
    client.force_login(boss)
    (row,) = one.drives.all()
    seen = (
        ("admin:experiments_participant_change", one.pk),
        ("admin:telepresence_sessions_session_change", row.session_id),
        ("admin:telepresence_sessions_snapshot", row.session.snapshots.get().pk),
        ("admin:telepresence_sessions_session_states", row.session_id, "csv"),
        ("admin:surveys_response_change", Response.objects.first().pk),
    )
    for name, *arguments in seen:
        assert client.get(reverse(name, args=arguments)).status_code == 200, name
    left_out = {"exclude": "1", "reason": "The robot was moved by hand, zqexcluded."}
    excluded = client.post(
        reverse("admin:experiments_drive_exclude", args=[row.pk]), left_out, follow=True
    )
    assert excluded.status_code == 200
    assert Drive.objects.get().excluded_by == boss
    return client


def exported(study: Study, folder: Path) -> Path:
    choice = Selection(identified=True, formats=frozenset(ON_REQUEST))
    assert list(unpacked(export_files(study, choice), folder))
    return folder


def theirs(walker: Walker) -> list:
    guest = walker.user.is_guest
    own = [User.objects.filter(pk=walker.user.pk)] if guest else []
    return [*rows_of(walker.participant), *own]


@pytest.mark.django_db(transaction=True)
@pytest.mark.parametrize("kind", ["full", "guest"])
def test_a_withdrawal_leaves_no_data_of_the_participant_anywhere(kind, log, tmp_path):
    walker = walked(kind)
    looked_at(walker)
    call_command("export_study", "exploration", out=tmp_path / "taken", identified=True)
    own_traces.spread_out(theirs(walker), BEGAN)
    own_traces.spread_out([AuditEntry.objects.all()], BEGAN + datetime.timedelta(days=30))
    reports.home(walker.study).mkdir(parents=True, exist_ok=True)
    (reports.home(walker.study) / "table.json").write_text(SAID)
    study = walker.study
    others = [Study.objects.all(), User.objects.exclude(pk=walker.user.pk)]
    if kind == "full":  # the account stays
        others.append(User.objects.all())
    values = values_of(theirs(walker), but=others)
    before = exported(study, tmp_path / "before")
    assert len(in_files(before, values)) > 10
    assert len(in_tables(values)) > 100
    assert len(in_files(Path(site_settings.VAR_DIR), values)) > 50

    answer = walker.client.post(reverse("study_withdraw", args=[walker.participant.code]))
    assert answer.status_code == 200
    call_command("forget", stdout=io.StringIO())

    assert in_tables(values) == set()
    assert in_bytes(log.text.encode(), values) - sessions_in(values) == set()
    assert in_files(exported(study, tmp_path / "after"), values) == set()
    if connection.vendor == "sqlite":
        assert in_files(Path(connection.settings_dict["NAME"]).parent, values) == set()
    row = Participant.objects.get()
    assert (row.status, row.withdrawn_step, row.stage) == ("withdrawn", "experience", "filled")
    assert row.cell


def sessions_in(values) -> set[str]:
    """Log lines name sessions; the privacy page says so."""
    return {
        f"{name}: {word!r}"
        for name, words in values.items()
        for word in words & values["Session.id"]
    }


@pytest.mark.parametrize("kind", ["full", "guest"])
def test_audit_log_keeps_acts_of_staff_without_the_participant(kind):
    walker = walked(kind)
    looked_at(walker)
    boss = User.objects.get(username="boss").pk
    about = {"person_opened", "answers_opened", "session_exported", "drive_excluded"}
    assert (
        set(AuditEntry.objects.filter(person=walker.user.pk).values_list("act", flat=True)) > about
    )
    walker.client.post(reverse("study_withdraw", args=[walker.participant.code]))
    assert not AuditEntry.objects.filter(person=walker.user.pk, study="exploration").exists()
    kept = AuditEntry.objects.filter(act__in=[*about, "robot_granted", "withdrawn"])
    assert {(entry.person, entry.thing) for entry in kept} == {(None, "")}
    assert {entry.at.time() for entry in kept} == {datetime.time(0)}
    assert {entry.actor for entry in kept.filter(act__in=about)} == {boss}
    assert {entry.actor for entry in kept.exclude(act__in=about)} == {None}
    # an account without a password was made for the study, and went with it
    assert AuditEntry.objects.filter(actor=walker.user.pk).exists() is False
