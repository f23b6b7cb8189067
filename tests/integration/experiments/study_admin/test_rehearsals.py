"""A rehearsal is started, followed, ended and read on pages of the administration."""

import datetime
import json
from dataclasses import asdict

import pytest
from django.urls import reverse
from django.utils import timezone

from experiments import publishing
from experiments.models import Rehearsal
from experiments.rehearsal import runs
from experiments.rehearsal.report import ConditionReport, Issue, RehearsalReport, StepReport
from tests.support.browsers.html_page import faults, read
from tests.support.studies.members import signed_in
from tests.support.studies.studies import small_study
from tests.support.studies.study_site import cabin_with_giraff
from tests.support.studies.wizard_study import wizard_document

pytestmark = pytest.mark.django_db
REPORT = RehearsalReport(
    6,
    issues=[
        Issue("missed", {"number": 2}, "shut"),
        Issue("stuck", {"bot": 4, "where": "“Experience” does not continue"}, place="Experience"),
        Issue("empty", {"column": "states.charge"}),
    ],
    conditions=[ConditionReport("shut", 2, 1, [2], {}, 90.0, 120.0, 2.7, 5.0)],
    steps=[StepReport("Experience", 5, 120, 9, 1.7), StepReport("Drive", 5, 9, 0, 0.1, True)],
    expected_minutes=4.4,
    power=[{"effect": 0.5, "per_group": 64, "total": 128}],
)


def at(page: str, row) -> str:
    return reverse(f"admin:experiments_{page}", args=[row.pk])


@pytest.fixture
def study():
    cabin_with_giraff()
    return publishing.store(small_study(), timezone.now())


@pytest.fixture
def owner(client, study):
    return signed_in(client, "owner")


def running(study, **changes) -> Rehearsal:
    row = runs.begin(study, "lab", timezone.now())
    Rehearsal.objects.filter(pk=row.pk).update(**changes)
    return Rehearsal.objects.get(pk=row.pk)


def page_text(client, row) -> str:
    page = read(client.get(at("rehearsal_change", row)))
    assert faults(page) == []
    return page.text


def test_an_owner_starts_a_rehearsal_and_a_second_request_leads_to_it(client, owner, study):
    for page in ("study_change", "study_publish"):
        text = read(client.get(at(page, study))).text
        assert "8 bots take part in a copy of the site, in every condition (2)" in text
        assert "manage.py rehearse_study cabin-study:1" in text
    first = client.post(at("rehearsal_start", study))
    (row,) = Rehearsal.objects.all()
    assert (row.status, row.sha256) == (runs.Status.WAITING, study.sha256)
    signed_in(client, "owner", name="olga")
    second = client.post(at("rehearsal_start", study))
    assert first.url == second.url == at("rehearsal_change", row)
    assert Rehearsal.objects.count() == 1
    for page in ("study_change", "study_publish"):
        found = read(client.get(at(page, study)))
        assert "Waiting to start." in found.text
        assert "Rehearse now" not in found.text
    assert faults(found) == []


def test_a_viewer_follows_a_rehearsal_and_neither_starts_nor_ends_one(client, study):
    signed_in(client, "viewer")
    assert "Rehearse now" not in read(client.get(at("study_change", study))).text
    assert client.post(at("rehearsal_start", study)).status_code == 404
    row = running(study)
    assert "End the rehearsal" not in page_text(client, row)
    assert client.post(at("rehearsal_end", row)).status_code == 404
    assert runs.is_live(Rehearsal.objects.get(), timezone.now())


def test_the_page_shows_the_progress_of_a_rehearsal(client, owner, study):
    row = running(study)
    assert "Preparing a copy of the site on lab." in page_text(client, row)
    progress = {"drives": 5, "conditions": 1, "of_conditions": 2, "bots": 3, "of_bots": 8}
    runs.sign(row.pk, timezone.now(), progress=progress)
    state = client.get(at("rehearsal_state", row)).json()
    sentence = (
        "Running on lab: 5 drives have ended, in 1 of 2 conditions; 3 of 8 bots have finished."
    )
    assert state == {"text": sentence, "live": True, "progress": progress}
    assert sentence in page_text(client, row)
    runs.sign(row.pk, timezone.now(), progress={**progress, "bots": 8})
    assert "Evaluating" in client.get(at("rehearsal_state", row)).json()["text"]


def test_a_user_ends_a_rehearsal_and_is_named(client, owner, study):
    row = running(study)
    client.post(at("rehearsal_end", row))
    assert f"Ended by {owner.shown_name} before it was finished." in page_text(client, row)
    assert "Rehearse now" in page_text(client, row)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"seen_at": datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC)}, "no sign of life"),
        ({"status": "failed", "reason": "Its process ended: it was ended by SIGKILL."}, "SIGKILL"),
    ],
)
def test_a_failed_rehearsal_shows_its_reason_and_another_can_be_started(
    client, owner, study, changes, sentence
):
    row = running(study, **changes)
    text = page_text(client, row)
    assert "Failed: " in text
    assert sentence in text
    Rehearsal.objects.exclude(status="running").update(live_key="ended")
    client.post(at("rehearsal_start", study))
    assert Rehearsal.objects.filter(status=runs.Status.WAITING).count() == 1


def test_page_reports_that_no_process_runs_rehearsals(client, owner, study):
    row = runs.request(study, timezone.now() - 2 * runs.NOT_TAKEN)
    assert "this site has no process that runs rehearsals" in page_text(client, row)
    running(publishing.store(small_study(slug="other"), timezone.now()))
    assert "Waiting until another rehearsal has ended." in page_text(client, row)


def test_a_report_is_read_by_condition_with_the_pages_of_the_builder(client, owner, study):
    row = running(study)
    runs.finish(row.pk, REPORT)
    page = read(client.get(at("rehearsal_change", row)))
    assert faults(page) == []
    assert [e.text for e in page.all("h3")] == ["Shut", "The whole study", "The whole study"]
    links = {e.text: e.attributes["href"] for e in page.all("a")}
    course = reverse("admin:experiments_study_part", args=[study.pk, "courses", 0])
    assert links["No bot passed checkpoint 2."] == course
    step = reverse("admin:experiments_study_part", args=[study.pk, "steps", 1])
    assert links["Bot 4 got stuck: “Experience” does not continue."] == step
    assert "No bot gave a value for states.charge." in page.text
    assert "2 problems found." in page.text
    assert "Drive: on the robot's page" in page.text
    assert "A participant needs about 4.4 minutes." in page.text
    assert "a difference of 0.5 standard deviations: 128" in page.text
    assert "This rehearsal is of the study as it is now." in page.text
    assert json.loads(client.get(at("rehearsal_report", row)).content) == asdict(REPORT)


def test_an_old_report_without_issues_is_readable(client, owner, study):
    row = running(study, report={"problems": ["Condition shut: slow."], "notes": ["Hm."]})
    Rehearsal.objects.filter(pk=row.pk).update(status="done", finished_at=timezone.now())
    text = page_text(client, row)
    assert "1 problem found." in text
    assert "Condition shut: slow." in text
    assert "Hm." in text


def test_page_states_that_a_rehearsal_of_an_older_draft_does_not_count(client, owner, study):
    row = running(study)
    publishing.save_draft(study, small_study(title={"en": "Hut"}))
    runs.finish(row.pk, RehearsalReport(6, passed=True))
    assert "so it does not count" in page_text(client, row)
    text = read(client.get(at("study_publish", study))).text
    assert "No rehearsal of this exact definition has passed." in text
    assert "Passed. The study has changed since that rehearsal started" in text


def test_page_explains_why_bots_cannot_play_a_study(client, owner, study):
    with_operator = publishing.store(
        small_study(**wizard_document(study={"slug": "cabin-study", "version": 2})), timezone.now()
    )
    text = read(client.get(at("study_change", with_operator))).text
    assert "The study has a hidden operator" in text
    assert "Rehearse now" not in text
    client.post(at("rehearsal_start", with_operator))
    assert Rehearsal.objects.count() == 0
