"""Two processes repeatedly request a robot at the same instant, on real databases."""

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator

import pytest

from tests.support.paths import ROOT
from tests.support.programs.postgres import running_postgres
from tests.support.sessions.site import DATABASE, empty_database

pytestmark = [pytest.mark.long, pytest.mark.nightly]

ROUNDS = [10, pytest.param(10_000, marks=pytest.mark.soak)]
RUNNER = """
import json, sys
import django
django.setup()
"""


@pytest.fixture(
    scope="module", params=["sqlite", pytest.param("postgres", marks=pytest.mark.postgres)]
)
def database(request, tmp_path_factory) -> Iterator[dict[str, str]]:
    var = tmp_path_factory.mktemp(f"races-{request.param}")
    environment = {
        **os.environ,
        "VAR_DIR": str(var),
        "HTTP_ONLY": "1",
        "DJANGO_SETTINGS_MODULE": "tests.settings",
        "LOG_LEVEL": "WARNING",
    }
    environment.pop("DATABASE_URL", None)
    if request.param == "sqlite":
        shutil.copyfile(empty_database(), var / DATABASE)
        yield environment
        return
    with running_postgres() as server:
        yield {**environment, "DATABASE_URL": server.url}


def django(environment: dict[str, str], code: str) -> str:
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


class Racers:
    """Two processes that request a robot at the same instant."""

    def __init__(self, environment: dict[str, str]) -> None:
        command = [sys.executable, "-m", "tests.support.sessions.lease_racer"]
        self.processes = [
            subprocess.Popen(
                command,
                cwd=ROOT,
                env=environment,
                text=True,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
            )
            for _ in range(2)
        ]
        for process in self.processes:
            assert process.stdout.readline() == "ready\n"

    def race(self, *questions: str) -> list[dict]:
        start = time.time() + 0.004
        for process, question in zip(self.processes, questions, strict=True):
            process.stdin.write(f"{start} {question}\n")
            process.stdin.flush()
        return [json.loads(process.stdout.readline()) for process in self.processes]

    def close(self) -> None:
        for process in self.processes:
            process.stdin.close()
        for process in self.processes:
            process.wait(timeout=40)


PREPARE = (
    RUNNER
    + """
from accounts.models import User
from tests.support.robots import create_robots, unsaved_robot
from django.utils import timezone
now = timezone.now() + timezone.timedelta(hours=1)  # online during the whole test
create_robots(
    *(unsaved_robot(name=f"{prefix}-{n}", title="r", connection="ONLINE", last_seen_at=now)
    for n in range(rounds))
)
for name in ("ana", "ben"):
    User.objects.get_or_create(username=name)
"""
)
COUNT = (
    RUNNER
    + """
from sessions.models import Lease, Session
live = Session.objects.exclude(state="ended").filter(robot__name__startswith=prefix)
leases = Lease.objects.filter(robot__name__startswith=prefix)
print(json.dumps({
    "driving": live.exclude(state="waiting").count(),
    "waiting": live.filter(state="waiting").count(),
    "leases": leases.count(), "epochs": sorted(set(leases.values_list("epoch", flat=True))),
    "held": leases.filter(session__isnull=False).count(),
    "agree": all(lease.session.state == "connecting" for lease in leases.select_related("session")),
}))
"""
)


def run(
    environment: dict[str, str], prefix: str, visitors: tuple[str, str], rounds: int
) -> tuple[list[list[dict]], dict]:
    prefix += str(rounds)
    names = f"prefix, rounds = {prefix!r}, {rounds}\n"
    django(environment, names + PREPARE)
    racers = Racers(environment)
    try:
        answers = [
            racers.race(f"{prefix}-{n} {visitors[0]} left", f"{prefix}-{n} {visitors[1]} right")
            for n in range(rounds)
        ]
    finally:
        racers.close()
    return answers, json.loads(django(environment, names + COUNT))


def counts(rounds: int, waiting: int) -> dict:
    """Return the expected sessions and leases: one of each is granted in each round."""
    granted = {"driving": rounds, "leases": rounds, "held": rounds}
    return granted | {"waiting": waiting, "epochs": [1], "agree": True}


@pytest.mark.parametrize("rounds", ROUNDS)
def test_one_of_two_visitors_drives_and_the_other_waits(database, rounds):
    answered, found = run(database, "two", ("ana", "ben"), rounds)
    kinds = [sorted(answer["kind"] for answer in answers) for answers in answered]
    assert kinds == [["Queued", "TakeGranted"]] * rounds
    winners = [answers[0]["kind"] == "TakeGranted" for answers in answered]
    assert 0 < sum(winners) < rounds, "one side won every time: they did not race"
    assert found == counts(rounds, waiting=rounds)


@pytest.mark.parametrize("rounds", ROUNDS)
def test_one_of_two_tabs_drives_and_the_other_gets_the_session(database, rounds):
    answered, found = run(database, "tab", ("ana", "ana"), rounds)
    for answers in answered:
        assert sorted(answer["kind"] for answer in answers) == ["Refused", "TakeGranted"]
        assert answers[0]["session"] == answers[1]["session"], "two tabs, one session"
    assert found == counts(rounds, waiting=0)
