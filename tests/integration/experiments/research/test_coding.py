"""Coding of replays: stored changes, access, files, agreement, withdrawal."""

import datetime
import functools
import json
import uuid

import pytest
from django.core.files.uploadedfile import SimpleUploadedFile
from django.urls import reverse
from django.utils import timezone

from accounts.models import AuditEntry
from experiments.coding import store
from experiments.models import Coding, CodingEdit, CodingSchemeVersion, Participant, StudyMember
from experiments.participation.own_data.gathering import gather
from experiments.participation.withdrawal import receipt
from experiments.participation.withdrawal.deletion import withdraw
from robots.files import limited_process
from robots.files.limited_process import ChildLimits
from tests.support.browsers.html_page import read
from tests.support.people import person
from tests.support.sessions import replays
from tests.support.studies.members import member

pytestmark = pytest.mark.django_db
SCHEME = {
    "blind": True,
    "codes": [
        {
            "code": "help",
            "name": "Asks for help",
            "kind": "point",
            "key": "h",
            "modifiers": [{"name": "whom", "values": ["robot", "visitor"]}],
        },
        {"code": "lost", "name": "Seems lost", "kind": "interval", "key": "l", "group": "route"},
        {"code": "sure", "name": "Knows", "kind": "interval", "key": "s", "group": "route"},
    ],
}


@pytest.fixture
def drive():
    """A minute that was driven in a study with a coding scheme."""
    session = replays.session(replays.cabin_robot(), person("ada"), seconds=60)
    replays.record(session, seconds=60)
    study = replays.study()
    store.store_scheme(study, store.scheme_from(SCHEME), timezone.now())
    found = replays.drive(replays.participant(study, session.visitor), session)
    replays.told(session, 5.0, "door_changed", detail="hall closed")
    replays.told(session, 6.0, "collision", detail="ahead")
    return found


def coder(name: str, role: str = "coder"):
    return member(role, name=name)


def edit(code: str, begin: float, end: float | None = None, **more) -> dict:
    ids = {"id": str(uuid.uuid4()), "event": str(uuid.uuid4()), "base": 0}
    return {**ids, "code": code, "begin": begin, "end": end, **more}


def save(client, drive, *edits: dict):
    address = reverse("coding_save", args=[drive.session_id])
    body = json.dumps({"edits": edits})
    return client.post(address, body, content_type="application/json")


def finish(client, drive, **more):
    return client.post(reverse("coding_done", args=[drive.session_id]), more)


def as_coder(client, name: str, role: str = "coder"):
    client.force_login(coder(name, role))
    return client


def events(client, drive) -> list:
    found = client.get(reverse("coding_events", args=[drive.session_id])).json()["saved"]
    return [(one["code"], one["begin"], one["end"], one["comment"]) for one in found]


def test_a_change_is_a_version_with_its_coder_and_time_and_is_stored_once(client, drive):
    as_coder(client, "carl")
    first = edit("lost", 3.0)
    assert save(client, drive, first).status_code == 200
    assert save(client, drive, first).json()["conflicts"] == []  # a page that got no answer
    ended = {**first, "id": str(uuid.uuid4()), "base": 1, "end": 9.25, "comment": "at the door"}
    assert save(client, drive, ended).json()["conflicts"] == []
    assert events(client, drive) == [("lost", 3.0, 9.25, "at the door")]
    versions = CodingEdit.objects.order_by("version")
    assert [(one.version, one.end) for one in versions] == [(1, None), (2, 9.25)]
    assert {one.coding.coder.username for one in versions} == {"carl"}


def test_the_later_change_of_two_tabs_counts_and_both_stay_in_the_history(client, drive):
    as_coder(client, "carl")
    first = edit("help", 3.0)
    save(client, drive, first)
    for comment, conflicts in (("one", []), ("two", [first["event"]])):
        change = {**first, "id": str(uuid.uuid4()), "base": 1, "comment": comment}
        assert save(client, drive, change).json()["conflicts"] == conflicts
    assert events(client, drive) == [("help", 3.0, None, "two")]
    assert CodingEdit.objects.count() == 3
    deleted = {**first, "id": str(uuid.uuid4()), "base": 3, "is_deleted": True}
    save(client, drive, deleted)
    assert events(client, drive) == []


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"code": "gaze"}, "no code “gaze”"),
        ({"end": 5.0}, "can't have an end"),
        ({"comment": "a\x00"}, "comment"),
        ({"modifiers": {"whom": "dog"}}, "modifier"),
    ],
)
def test_an_invalid_change_is_refused_with_its_reason_and_the_others_are_stored(
    client, drive, change, told
):
    as_coder(client, "carl")
    bad = {**edit("help", 3.0), **change}
    answer = save(client, drive, bad, edit("help", 4.0)).json()
    assert told in answer["refused"][bad["id"]]
    assert events(client, drive) == [("help", 4.0, None, "")]


@pytest.mark.parametrize("body", [b"[", b"{}", b'{"edits": [{"id": 1}]}', b'{"edits": 3}'])
def test_malformed_requests_are_refused(client, drive, body):
    as_coder(client, "carl")
    address = reverse("coding_save", args=[drive.session_id])
    assert client.post(address, body, content_type="application/json").status_code == 400


def test_a_coding_with_a_state_that_is_on_cannot_be_finished(client, drive):
    as_coder(client, "carl")
    save(client, drive, edit("lost", 3.0))
    answer = finish(client, drive)
    assert answer.status_code == 409
    assert "must end" in answer.json()["problem"]
    assert not Coding.objects.get().done_at


def test_codings_are_compared_only_when_all_coders_are_done(client, drive):
    page = reverse("study_coding", args=["cabin-study"])
    as_coder(client, "carl")
    save(client, drive, edit("lost", 3.0, 9.0), edit("help", 20.0))
    assert finish(client, drive).json()["isDone"]
    bea = coder("bea")
    client.force_login(bea)
    save(client, drive, edit("lost", 4.0, 9.0))
    assert events(client, drive) == [("lost", 4.0, 9.0, "")]
    assert "No session has been finished by two coders" in client.get(page).text
    assert finish(client, drive).json()["isShown"]
    text = client.get(page).text
    # lost, 60 bins: 6 against 5 of them; p_o = 59/60, p_e = (6*5 + 54*55)/3600
    kappa = (59 / 60 - (30 + 54 * 55) / 3600) / (1 - (30 + 54 * 55) / 3600)
    assert f"{kappa:.2f}" in text
    assert "C1 – C2" in text
    assert "carl" not in text
    # and stay as they are
    assert save(client, drive, edit("help", 1.0)).status_code == 409
    assert finish(client, drive, again="1").status_code == 409


def test_a_finished_coding_can_be_reopened_until_it_is_compared(client, drive):
    as_coder(client, "carl")
    save(client, drive, edit("help", 20.0))
    finish(client, drive)
    assert save(client, drive, edit("help", 1.0)).status_code == 409
    assert not finish(client, drive, again="1").json()["isDone"]
    assert save(client, drive, edit("help", 1.0)).status_code == 200


def test_a_coder_sees_nothing_of_the_study_but_its_coding(client, drive):
    as_coder(client, "carl")
    session = drive.session_id
    for name, args, status in (
        ("study_coding", ["cabin-study"], 200),
        ("code_session", [session], 200),
        ("replay", [session], 404),
        ("replay_data", [session], 404),
        ("study_live", ["cabin-study"], 404),
        ("analysis", ["cabin-study"], 404),
        ("analysis_export", ["cabin-study"], 404),
    ):
        assert client.get(reverse(name, args=args)).status_code == status, name
    text = client.get(reverse("code_session", args=[session])).text
    assert drive.participant.code not in text
    upload = reverse("coding_scheme", args=["cabin-study"])
    assert client.post(upload).status_code == 404
    client.force_login(coder("vera", "viewer"))
    assert client.get(reverse("study_coding", args=["cabin-study"])).status_code == 200
    assert client.get(reverse("code_session", args=[session])).status_code == 404
    client.force_login(person("somebody"))
    assert client.get(reverse("study_coding", args=["cabin-study"])).status_code == 404


def test_a_coder_who_is_staff_finds_no_participants_in_the_administration(client, drive):
    user = coder("carl")
    user.is_staff = True
    user.save()
    client.force_login(user)
    page = client.get(reverse("admin:experiments_participant_changelist"))
    assert page.status_code in {302, 403}


def test_a_blind_coder_gets_nothing_that_reveals_the_condition(client, drive):
    as_coder(client, "carl")
    text = client.get(reverse("code_session", args=[drive.session_id])).text
    condition = drive.participant.study.as_definition().condition(drive.condition)
    assert condition.title["en"] not in text
    record = client.get(reverse("coding_record", args=[drive.session_id])).json()
    assert record["states"]["t"]
    assert not record["network"]["t"]
    assert not record["commands"]["t"]
    assert [event[2] for event in record["events"]] == ["collision"]


def file(content: bytes, name: str = "coding.eaf") -> SimpleUploadedFile:
    return SimpleUploadedFile(name, content)


@pytest.mark.parametrize("kind", ["eaf", "boris"])
def test_an_exported_coding_can_be_imported(client, drive, kind):
    as_coder(client, "carl")
    chosen = {"modifiers": {"whom": "robot"}, "comment": "loud"}
    save(client, drive, edit("lost", 3.0, 9.0), edit("help", 20.0, **chosen))
    written = client.get(reverse(f"coding_{kind}", args=[drive.session_id]))
    assert written["Content-Disposition"].endswith(f'-C1.{kind}"')
    entry = AuditEntry.objects.get(act="coding_exported")
    assert (entry.thing, entry.detail) == (str(drive.session_id), kind)
    before = events(client, drive)
    save(client, drive, edit("help", 50.0))
    address = reverse("coding_import", args=[drive.session_id])
    page = client.post(address, {"file": file(written.content)}, follow=True)
    assert "2 events were imported" in page.text
    assert events(client, drive) == before
    assert CodingEdit.objects.get(comment="loud", version=1, begin=20.0, at__gt=edit_time(before))


def edit_time(_before) -> datetime.datetime:
    first = CodingEdit.objects.filter(comment="loud").order_by("at").first()
    assert first.modifiers == {"whom": "robot"}
    return first.at


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b'<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/passwd">]><a>&b;</a>', "document type"),
        (b"", "not valid JSON"),
        (b"x" * (5 * 1024 * 1024 + 1), "larger than 5 MB"),
        (b'{"observations": {"S": {"events": [[99, "", "help", "", ""]]}}}', "outside the session"),
    ],
)
def test_an_invalid_file_is_refused_with_the_reason_and_changes_nothing(
    client, drive, content, told
):
    as_coder(client, "carl")
    save(client, drive, edit("help", 20.0))
    address = reverse("coding_import", args=[drive.session_id])
    assert told in client.post(address, {"file": file(content)}, follow=True).text
    assert events(client, drive) == [("help", 20.0, None, "")]


def test_a_file_that_takes_too_long_changes_nothing(client, drive, monkeypatch):
    as_coder(client, "carl")
    monkeypatch.setattr(
        limited_process, "ChildLimits", functools.partial(ChildLimits, elapsed=0.01)
    )
    page = client.post(
        reverse("coding_import", args=[drive.session_id]), {"file": file(b"{}")}, follow=True
    )
    assert "The file needs too much memory or time" in page.text
    assert events(client, drive) == []


def test_a_new_scheme_is_a_new_version_and_finished_codings_stay(client, drive):
    as_coder(client, "carl")
    save(client, drive, edit("help", 20.0))
    client.force_login(coder("rita", "researcher"))
    address = reverse("coding_scheme", args=["cabin-study"])
    bad = client.post(address, {"file": file(b'[{"code": "a"}]', "s.json")}, follow=True)
    assert "missing required field" in bad.text
    same = file(json.dumps(SCHEME).encode(), "s.json")
    client.post(address, {"file": same})
    assert CodingSchemeVersion.objects.count() == 1
    new = {**SCHEME, "codes": SCHEME["codes"][:1], "blind": False}
    page = client.post(address, {"file": file(json.dumps(new).encode(), "s.json")}, follow=True)
    assert "version 2" in page.text
    assert (
        drive.participant.study.as_definition().condition(drive.condition).title["en"] in page.text
    )
    assert events(client, drive) == []
    assert CodingEdit.objects.count() == 1
    # what a page still sends that was opened before
    client.force_login(Coding.objects.get().coder)
    body = json.dumps({"edits": [edit("lost", 30.0)]})
    address = reverse("coding_save", args=[drive.session_id]) + "?scheme=1"
    assert len(client.post(address, body, content_type="application/json").json()["saved"]) == 2
    assert Coding.objects.count() == 1


def test_the_scheme_of_a_definition_is_used_without_an_upload(drive):
    study = drive.participant.study
    CodingSchemeVersion.objects.all().delete()
    study.definition = {**study.definition, "coding": SCHEME}
    row = store.scheme_of(study, timezone.now())
    assert (row.version, store.read_scheme(row)) == (1, store.scheme_from(SCHEME))


def test_codings_go_with_the_withdrawal_of_the_participant(client, drive):
    as_coder(client, "carl")
    save(client, drive, edit("help", 20.0))
    now = timezone.now()
    type(drive.session).objects.update(closed_at=now)
    type(drive).objects.update(settled_at=now)
    (own,) = gather(drive.session.visitor)["drives"]
    (noted,) = own["codings"]
    assert (noted["coder"], noted["events"][0]["begin"]) == ("C1", 20.0)
    participant = Participant.objects.get(pk=drive.participant_id)
    assert receipt.of(participant, "en", now).deleted["notes"] == 1
    withdraw(participant, now)
    assert (Coding.objects.count(), CodingEdit.objects.count()) == (0, 0)
    assert client.get(reverse("code_session", args=[drive.session_id])).status_code == 404


def test_a_coding_outlives_its_coders_account_without_them(client, drive):
    as_coder(client, "carl")
    save(client, drive, edit("help", 20.0))
    StudyMember.objects.all().delete()
    Coding.objects.get().coder.delete()
    assert (Coding.objects.get().coder, Coding.objects.get().number) == (None, 1)
    assert CodingEdit.objects.count() == 1


def test_page_of_a_study_without_scheme_leads_to_the_builder(client):
    plain = replays.study()
    client.force_login(person("boss", is_staff=True, is_superuser=True))
    page = read(client.get(reverse("study_coding", args=[plain.slug])))
    build = reverse("admin:experiments_study_section", args=[plain.pk, "coding"])
    assert build in [a.attributes.get("href") for a in page.all("a")]
    assert client.get(build).status_code == 200
