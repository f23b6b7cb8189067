"""One rehearsal of a study at a time, and what becomes of one whose process is gone."""

import datetime

import pytest

from experiments import publishing
from experiments.models import Rehearsal
from experiments.rehearsal import runs
from experiments.rehearsal.report import RehearsalReport
from tests.integration.experiments.test_publishing import NOW
from tests.support.people import person
from tests.support.studies.studies import small_study

pytestmark = pytest.mark.django_db
LATER = NOW + runs.SILENT + datetime.timedelta(seconds=1)


@pytest.fixture
def study():
    return publishing.store(small_study(), NOW)


def running(study) -> Rehearsal:
    row = runs.begin(study, "lab", NOW)
    return Rehearsal.objects.get(pk=row.pk)


def test_of_two_who_ask_for_a_rehearsal_one_is_heard(study):
    runs.request(study, NOW)
    with pytest.raises(runs.AlreadyRehearsedError):
        runs.request(study, NOW)
    assert Rehearsal.objects.count() == 1


def test_of_two_processes_one_takes_a_rehearsal_and_each_takes_the_oldest(study):
    other = publishing.store(small_study(slug="other"), NOW)
    second = runs.request(other, NOW + datetime.timedelta(seconds=1))
    first = runs.request(study, NOW)
    assert runs.take_next("lab", NOW) == first
    assert not runs.take(first, "hall", NOW)
    assert runs.take_next("hall", NOW) == second
    assert runs.take_next("hall", NOW) is None


def test_the_command_takes_the_rehearsal_that_waits_and_none_that_runs(study):
    asked = runs.request(study, NOW)
    assert runs.begin(study, "lab", NOW) == asked
    with pytest.raises(runs.AlreadyRehearsedError):
        runs.begin(study, "hall", NOW)


def test_one_that_was_not_signed_for_a_while_is_lost_and_gives_its_place_away(study):
    lost = running(study)
    assert runs.is_live(lost, NOW + runs.SILENT)
    assert runs.is_lost(lost, LATER)
    again = runs.request(study, LATER)
    lost.refresh_from_db()
    assert (lost.status, lost.reason) == (runs.Status.FAILED, runs.LOST)
    assert again.status == runs.Status.WAITING
    assert not runs.sign(lost.pk, LATER)  # its process signs again, and learns that it is to end


def test_one_that_is_signed_keeps_its_place(study):
    row = running(study)
    assert runs.sign(row.pk, LATER, progress={"bots": 1})
    with pytest.raises(runs.AlreadyRehearsedError):
        runs.request(study, LATER)


def test_results_are_not_kept_after_a_rehearsal_was_ended(study):
    row, user = running(study), person("ada")
    assert runs.stop(row.pk, user)
    assert not runs.finish(row.pk, RehearsalReport(1, passed=True))
    assert not runs.fail(row.pk, "It was killed.")
    row.refresh_from_db()
    assert (row.status, row.ended_by, row.passed) == (runs.Status.STOPPED, user, False)
    assert publishing.passed_rehearsal(study) is None
    runs.request(study, NOW)


def test_a_report_is_kept_and_counts_for_this_definition(study):
    row = running(study)
    assert runs.finish(row.pk, RehearsalReport(1, passed=True))
    assert publishing.passed_rehearsal(study) == row
