"""The receipt of a withdrawal: what was deleted, what stays, and what had been exported."""

import re

import pytest
from django.core.management import call_command
from django.urls import reverse

from accounts import audit
from accounts.models import User
from accounts.passwordless import create_guest
from experiments.models import Participant, StudyMember
from experiments.participation.withdrawal import receipt as receipts
from experiments.participation.withdrawal.receipt import WHAT
from tests.support.browsers.html_page import Page, faults, read
from tests.support.people import person
from tests.support.studies import participants as p
from tests.support.studies.own_traces import in_tables
from tests.support.studies.study_walk import Walker

pytestmark = pytest.mark.django_db
DOWNLOAD = "/taking-part/receipt.txt"


@pytest.fixture
def walker():
    found = Walker(p.published(p.of("exploration")), person("ada"), p.site())
    found.come()
    found.do()
    return found


def left(walker: Walker, **headers: str) -> Page:
    """The page after leaving."""
    address = reverse("study_withdraw", args=[walker.participant.code])
    page = read(walker.client.post(address, headers=headers))
    assert faults(page) == []
    return page


def carried(page: Page) -> str:
    return next(
        one.attributes["value"] for one in page.all("input") if one.attributes["name"] == "receipt"
    )


def facts(page: Page) -> dict[str, str]:
    names, values = ([" ".join(e.text.split()) for e in page.all(tag)] for tag in ("dt", "dd"))
    return dict(zip(names, values, strict=True))


def test_receipt_counts_deleted_data_and_lists_what_is_kept(walker):
    walker.drive()
    page = left(walker)
    assert facts(page)["Drives"] == "1"
    assert facts(page)["Consents"] == "1"
    for heading in ("What was deleted", "What stays, and why", "Who to ask"):
        assert heading in [one.text for one in page.all("h2")]
    assert "Nothing from this study was exported while you took part." in page.text
    assert "Your account stays if it has a password" in page.text
    assert "Public datasets made from now on do not have this entry." in page.text


@pytest.mark.parametrize("is_recruited", [False, True])
def test_page_before_and_receipt_and_privacy_page_list_the_same(client, is_recruited):
    study = p.published(p.of("exploration"), entry="code")
    came = {"PROLIFIC_PID": "5f0c"} if is_recruited else {}
    one = p.comer(study, create_guest(User.Kind.PARTICIPANT), recruitment=came)
    client.force_login(one.user)
    address = reverse("study_withdraw", args=[one.code])
    before, after = read(client.get(address)), read(client.post(address))
    text = client.post(DOWNLOAD, {"receipt": carried(after)}).content.decode()
    everywhere = read(client.get(reverse("about")))
    for name, words in receipts.STAYS.items():
        is_shown = {"hash": is_recruited, "account": False}.get(name, True)
        for page in (before.text, after.text, text):
            assert (str(words) in page) == is_shown
        assert str(words) in everywhere.text


def test_copies_that_were_given_out_are_named_by_kind_time_and_role_and_not_by_name(walker):
    study = walker.study
    for name, role in (("zqowner", "owner"), ("zqviewer", "viewer"), ("zqformer", "")):
        user = person(name)
        if role:
            StudyMember.objects.create(slug=study.slug, user=user, role=role)
        chosen = "identified" if role == "owner" else ""
        audit.note("study_exported", actor=user, study=study.slug, thing="version 1", detail=chosen)
    audit.note("study_exported", study=study.slug, thing="version 2")
    audit.note("study_exported", study=study.slug, thing="version 1", at=p.later(-86400))
    page = left(walker)
    listed = [" ".join(one.text.split()) for one in page.all("dd")]
    assert listed[-3:] == [
        "dataset with names, free text and photos; an owner of the study",
        "dataset by participant code; a viewer of the study",
        "dataset by participant code; somebody who no longer has a role here",
    ]
    assert "zq" not in page.text


@pytest.mark.parametrize("act", sorted(audit.COPIES))
def test_receipt_lists_each_kind_of_copy_once_with_its_times(walker, act):
    walker.drive()
    session = walker.participant.drives.get().session_id
    scope = audit.COPIES[act]
    thing = {"version": "version 1", "session": session}.get(scope, "")
    study = "" if scope in {"driver", "respondent"} else walker.study.slug
    for _ in range(3):
        audit.note(act, study=study, thing=thing)
    page = left(walker)
    named = WHAT["pseudonymous" if act == "study_exported" else act]
    copies = [text for text in facts(page).values() if str(named) in text]
    assert copies == [f"{named}; the operators of the site (3 ×)"]
    assert "Nothing from this study was exported" not in page.text
    text = walker.client.post(DOWNLOAD, {"receipt": carried(page)}).content.decode()
    assert f": {named}; the operators of the site (3 ×)" in text


def test_participant_who_finished_keeps_the_completion_code(walker):
    walker.drive()
    for _ in range(20):
        if walker.participant.completion:
            break
        walker.do()
    code = walker.participant.completion_code
    assert len(code) == 8
    address = reverse("study_withdraw", args=[walker.participant.code])
    assert "Your completion code stays valid." in read(walker.client.get(address)).text
    page = left(walker)
    assert code in page.text
    text = walker.client.post(DOWNLOAD, {"receipt": carried(page)}).content.decode()
    assert f"Code for the recruitment site: {code}" in text
    row = Participant.objects.get()
    assert (row.status, row.completion, row.completion_code) == ("withdrawn", "done", code)
    assert row.withdrawn_stage == "answered"


def test_receipt_lists_an_export_by_the_command(walker, tmp_path):
    call_command("export_study", "exploration", out=tmp_path / "out", free_text=True)
    assert (
        "dataset by participant code, with free text; the operators of the site"
        in facts(left(walker)).values()
    )


def test_receipt_announces_the_later_deletion_of_a_drive_in_progress(walker):
    p.drive_of(walker.robot, walker.participant, moved=True)
    assert "Your drive in progress has been ended." in left(walker).text


@pytest.mark.parametrize("language", ["en", "es"])
def test_it_can_be_downloaded_as_text_and_is_stored_nowhere(walker, client, language):
    code = walker.participant.code
    walker.drive()
    page = left(walker, **{"accept-language": language})
    assert code in page.text
    answer = client.post(
        DOWNLOAD, {"receipt": carried(page)}, headers={"accept-language": language}
    )
    assert answer["Content-Disposition"].startswith('attachment; filename="withdrawal-exploration')
    text = answer.content.decode()
    assert code in text
    assert {"en": "- Drives: 1", "es": "- Recorridos: 1"}[language] in text
    assert not re.search(r"<|&|\n\n\n", text)
    assert in_tables({"code": {code.encode(), code.lower().encode()}}) == set()


def test_a_receipt_that_was_changed_or_is_old_is_not_found(walker, client, monkeypatch):
    receipt = carried(left(walker))
    assert client.post(DOWNLOAD, {"receipt": "x" + receipt}).status_code == 404
    assert client.post(DOWNLOAD).status_code == 404
    assert client.get(DOWNLOAD).status_code == 405
    monkeypatch.setattr(receipts, "SECONDS", -1)
    assert client.post(DOWNLOAD, {"receipt": receipt}).status_code == 404


def test_a_participant_who_declines_gets_one_too(walker):
    Participant.objects.update(step="consent", status="active")
    page = read(walker.send(go="decline"))
    assert faults(page) == []
    assert "What was deleted" in page.text
