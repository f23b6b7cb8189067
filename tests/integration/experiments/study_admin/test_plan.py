"""A plan in the administration: read, downloaded, simulated, and departed from."""

import datetime
import re
from importlib import import_module

import pytest
from django.apps import apps
from django.core.management import CommandError, call_command
from django.urls import reverse

from accounts.models import AuditEntry
from experiments import publishing
from experiments.extraction.build import freeze_of
from experiments.models import Participant, Study, StudyMember
from experiments.participation.withdrawal.deletion import withdraw
from experiments.study_admin.plan import by_test
from tests.integration.experiments.test_publishing import NOW
from tests.support.analysis.planned import PLAN, planned_study
from tests.support.browsers.html_page import read
from tests.support.patience import patient
from tests.support.studies.members import signed_in

pytestmark = pytest.mark.django_db
DAY = datetime.timedelta(days=1)


def page(study, name="plan"):
    return reverse(f"admin:experiments_study_{name}", args=[study.pk])


@pytest.fixture
def study():
    return publishing.store(planned_study(PLAN), NOW)


def published(study, at=NOW):
    Study.objects.filter(pk=study.pk).update(status="published", published_at=at)
    return Study.objects.get(pk=study.pk)


def joined(study, at):
    return Participant.objects.create(study=study, slot=str(at), created_at=at, seen_at=at)


def test_the_preregistration_is_read_and_downloaded(client, study):
    signed_in(client, "viewer")
    shown = read(client.get(page(study)))
    assert "A closed door takes time." in shown.text
    actions = {form.attributes.get("action") for form in shown.all("form")}
    assert not actions & {page(study, "power"), page(study, "deviations")}
    answer = client.get(page(study, "preregistration"))
    assert answer.headers["Content-Disposition"].endswith('cabin-study-1-preregistration.md"')
    assert f"SHA-256 of the draft: `{study.sha256}`." in answer.content.decode()
    assert "This is a draft" in answer.content.decode()


def test_a_version_knows_whether_it_was_frozen_before_its_data(study):
    assert freeze_of(study).before_data is None
    frozen = published(study)
    assert (freeze_of(frozen).frozen_at, freeze_of(frozen).before_data) == (
        f"{NOW:%Y-%m-%d %H:%M} UTC",
        True,
    )
    joined(frozen, NOW + DAY)
    assert freeze_of(frozen).before_data
    second = published(publishing.new_version(frozen, NOW), NOW + 2 * DAY)
    assert (freeze_of(second).before_data, freeze_of(second).earlier) == (True, 1)
    joined(second, NOW)
    assert not freeze_of(second).before_data


def test_a_withdrawal_does_not_change_what_was_frozen_before_data(study):
    first = published(study)
    early = joined(first, NOW + DAY)
    second = published(publishing.new_version(first, NOW), NOW + 2 * DAY)
    late = joined(second, NOW + 2 * DAY + datetime.timedelta(minutes=5))
    for one in (early, late):
        withdraw(one, NOW + 2 * DAY + datetime.timedelta(hours=1))
    assert freeze_of(first).before_data
    assert (freeze_of(second).before_data, freeze_of(second).earlier) == (True, 1)
    times = set(Participant.objects.values_list("created_at", flat=True))
    assert times == {first.published_at, second.published_at}, "and nothing of the person's"


def test_an_upgrade_corrects_the_times_of_earlier_withdrawals(study):
    frozen = published(study)
    one = joined(frozen, NOW + DAY)
    withdraw(one, NOW + DAY)
    Participant.objects.update(created_at=NOW.replace(hour=0, minute=0))
    assert not freeze_of(frozen).before_data
    import_module("experiments.migrations.0020_joined_after_publication").correct(apps, None)
    assert freeze_of(frozen).before_data


def test_page_states_in_its_language_whether_data_existed(client, study):
    signed_in(client, "viewer")
    frozen = published(study)
    joined(frozen, NOW + DAY)
    second = published(publishing.new_version(frozen, NOW), NOW + 2 * DAY)
    text = read(client.get(page(second))).text
    assert "No participant of this version had joined before that." in text
    assert "1 participant had joined an earlier version, whose data were known." in text
    client.cookies["django_language"] = "es"
    spanish = read(client.get(page(second))).text
    assert "Hasta entonces no se había unido nadie a esta versión." in spanish
    assert "participant of this version" not in spanish.partition("# Preregistration")[0]


def test_owners_state_deviations_after_publishing_and_others_do_not(client, study):
    signed_in(client, "owner")
    frozen = published(study)
    reported = {"deviations": "We stopped a week early."}
    assert client.post(page(study, "deviations"), reported).status_code == 302
    assert freeze_of(Study.objects.get()).deviations == reported["deviations"]
    assert Study.objects.get().sha256 == frozen.sha256
    assert AuditEntry.objects.filter(act="study_changed", detail="deviations").exists()
    StudyMember.objects.update(role="researcher")
    assert client.post(page(study, "deviations"), reported).status_code == 404


def test_numbers_of_participants_are_checked(client, study):
    signed_in(client, "researcher")
    for numbers in ("", "many", "0", "1001", "1 2 3 4 5 6 7 8 9"):
        assert client.post(page(study, "power"), {"participants": numbers}).status_code == 422


@pytest.mark.nightly
@pytest.mark.django_db(transaction=True)
def test_the_power_is_simulated_on_the_page(client, study, monkeypatch):
    monkeypatch.setattr("experiments.study_admin.plan.STUDIES", 40)
    monkeypatch.setattr("experiments.study_admin.plan.SECONDS", patient(60.0))
    signed_in(client, "researcher")
    shown = read(client.post(page(study, "power"), {"participants": "20, 40"}))
    assert {"20", "40"} < {head.text for head in shown.all("th")}
    cells = [cell.text for cell in shown.all("td")]
    start = cells.index("driving")
    assert cells[start : start + 4] == ["driving", "task_time", "shut - open", "h1"]
    few, many = (re.match(r"(0\.\d+|1\.000)\s*\S+–\S+$", cell) for cell in cells[start + 4 :][:2])
    assert float(few[1]) <= float(many[1])
    assert "participants give every test of a hypothesis a power of" in shown.text


def test_a_number_that_is_simulated_twice_has_one_column_and_they_ascend():
    head = ["Participants", "Analysis", "Measure", "Test", "Hypothesis", "Power", "from", "to"]
    rows = [
        [size, "driving", "task_time", "shut - open", "", power, "0", "1"]
        for size, power in (("8", "0.1"), ("8", "0.1"), ("64", "0.9"), ("38", "0.8"))
    ]
    found = by_test({"head": head, "rows": rows, "notes": ["38 are enough.", "Why."]})
    assert found["sizes"] == ["8", "38", "64"]
    assert found["heads"] == ["Analysis", "Measure", "Test"]
    ((names, cells),) = found["tests"]
    assert names == ("driving", "task_time", "shut - open")
    assert [power for power, _ in cells] == ["0.1", "0.8", "0.9"]


def test_command_prints_the_power_and_its_limits(study, capsys):
    call_command("power", study.slug, participants=[20], studies=20)
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split()[:4] == ["Participants", "Analysis", "Measure", "Test"]
    assert lines[1].startswith("20            driving   task_time")
    with pytest.raises(CommandError, match="There is no study"):
        call_command("power", "nowhere")
