"""The runner of rehearsals: processes that die, hang or cannot be started; a lost database."""

import time

import pytest
from django.db import OperationalError
from django.utils import timezone

from experiments import publishing
from experiments.models import Rehearsal
from experiments.rehearsal import runs
from robots.process.ending import interrupted_by_signals
from telepresence_site.children import Children
from telepresence_site.rehearsal import heartbeat, runner
from telepresence_site.rehearsal.runner import RehearsalRunner
from tests.support.people import person
from tests.support.sessions.site import wait_for
from tests.support.studies.studies import small_study

pytestmark = pytest.mark.django_db
SLEEPS = ["-c", "import time; time.sleep(600)"]


@pytest.fixture
def study():
    return publishing.store(small_study(), timezone.now())


@pytest.fixture
def children(tmp_path):
    made = Children(tmp_path / "log", {})
    yield made
    made.stop()


def status(row: Rehearsal) -> tuple[str, str]:
    return Rehearsal.objects.values_list("status", "reason").get(pk=row.pk)


def looks_until_ended(one: RehearsalRunner, children: Children) -> None:
    wait_for(lambda: one.look() or not children.running, 20, "the end of the process")


def test_one_rehearsal_runs_at_a_time_and_the_next_one_follows(children, study):
    first = runs.request(study, timezone.now())
    second = runs.request(
        publishing.store(small_study(slug="other"), timezone.now()), timezone.now()
    )
    one = RehearsalRunner(children, lambda _row: SLEEPS)
    for _ in range(3):
        one.look()
    assert (status(first)[0], status(second)[0]) == ("running", "waiting")
    assert len(children.running) == 1
    children.running[0].process.kill()
    looks_until_ended(one, children)
    assert status(first) == ("failed", "Its process ended: it was ended by SIGKILL.")
    one.look()
    one.look()
    assert status(second)[0] == "running"
    runs.request(study, timezone.now())  # the killed one can be run again


def test_reason_of_a_process_that_ends_is_quoted(children, study):
    row = runs.request(study, timezone.now())
    one = RehearsalRunner(children, lambda _row: ["-c", "raise SystemExit('No space left.')"])
    one.look()
    looks_until_ended(one, children)
    assert status(row) == ("failed", "Its process ended: No space left.")


def test_process_that_does_not_end_with_its_rehearsal_is_killed(children, study, monkeypatch):
    monkeypatch.setattr(runner, "END_SECONDS", 0.0)
    row = runs.request(study, timezone.now())
    one = RehearsalRunner(children, lambda _row: SLEEPS)
    one.look()
    runs.stop(row.pk, person("ada"))
    looks_until_ended(one, children)
    assert status(row) == ("stopped", "")


def test_rehearsal_that_cannot_start_fails_with_the_reason(children, study, monkeypatch):
    def full(*_args):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(children, "start", full)
    row = runs.request(study, timezone.now())
    RehearsalRunner(children).look()
    assert status(row) == ("failed", "It could not be started: No space left on device.")


def test_rehearsal_is_started_for_the_requested_version(study):
    row = runs.request(study, timezone.now())
    command = runner.rehearsal_command(row)
    assert command[1:] == ["rehearse_study", "cabin-study:1", "--requested", str(row.pk)]


@pytest.mark.django_db(transaction=True)
def test_process_signs_its_row_and_ends_when_its_rehearsal_was_ended(study, tmp_path, monkeypatch):
    monkeypatch.setattr(heartbeat, "PERIOD_SECONDS", 0.05)
    row = runs.begin(study, "lab", timezone.now())
    progress = tmp_path / "progress.json"
    progress.write_text('{"bots": 3}')
    rows = Rehearsal.objects.filter(pk=row.pk, progress={"bots": 3})

    def play() -> None:
        with interrupted_by_signals(), heartbeat.heartbeats(row.pk, progress):
            wait_for(rows.exists, 20, "a sign of life")
            runs.stop(row.pk, person("ada"))
            time.sleep(60)

    with pytest.raises(KeyboardInterrupt):
        play()


def test_result_waits_for_an_unavailable_database(monkeypatch):
    monkeypatch.setattr(heartbeat, "PERIOD_SECONDS", 0.0)
    monkeypatch.setattr(heartbeat.connection, "close", lambda: None)
    answers = [OperationalError("away"), OperationalError("away"), None]

    def write():
        if (answer := answers.pop(0)) is not None:
            raise answer

    heartbeat.retry_until_written(write)
    assert answers == []
