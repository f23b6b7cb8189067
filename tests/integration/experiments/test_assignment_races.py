"""Processes that assign participants at the same instant, on real databases: no cell gets more than
another by more than one.
"""

import json
import os
import shutil
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator

import pytest

from tests.support.paths import ROOT
from tests.support.programs.postgres import running_postgres
from tests.support.sessions.site import DATABASE, empty_database

pytestmark = [pytest.mark.long, pytest.mark.nightly]

ROUNDS = [10, pytest.param(1000, marks=pytest.mark.soak)]
PREPARE = """
import json, django
django.setup()
from accounts.models import User
from tests.support.studies import participants as p
from tests.support.studies.studies import small_study
from tests.support.studies.task_session import cabin_robot
cabin_robot()
study = p.published(small_study(allocation=allocation))
users = User.objects.bulk_create(User(username=f"visitor-{n}") for n in range(count))
print(json.dumps([str(p.comer(study, user).pk) for user in users]))
"""
COUNT = """
import json, django
django.setup()
from experiments.models import Draw
rows = list(Draw.objects.values_list("participant__cell", "number", "participant__stage"))
print(json.dumps(rows))
"""


@pytest.fixture(params=["sqlite", pytest.param("postgres", marks=pytest.mark.postgres)])
def database(request, tmp_path) -> Iterator[dict[str, str]]:
    environment = {
        **os.environ,
        "VAR_DIR": str(tmp_path),
        "HTTP_ONLY": "1",
        "DJANGO_SETTINGS_MODULE": "tests.settings",
        "LOG_LEVEL": "WARNING",
    }
    environment.pop("DATABASE_URL", None)
    if request.param == "sqlite":
        shutil.copyfile(empty_database(), tmp_path / DATABASE)
        yield environment
        return
    with running_postgres() as server:
        yield {**environment, "DATABASE_URL": server.url}


def django(environment: dict[str, str], code: str) -> list:
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
    return json.loads(done.stdout)


def race(environment: dict[str, str], keys: list[str]) -> list[list[str]]:
    """Return the answers to both of two participants who ask at once, for each pair."""
    command = [sys.executable, "-m", "tests.support.sessions.cell_racer"]
    racers = [
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
    try:
        assert [racer.stdout.readline() for racer in racers] == ["ready\n"] * 2
        answers = []
        for number in range(0, len(keys), 2):
            start = time.time() + 0.03
            for racer, key in zip(racers, keys[number : number + 2], strict=True):
                racer.stdin.write(f"{start} {key}\n")
                racer.stdin.flush()
            answers.append([racer.stdout.readline().strip() for racer in racers])
        return answers
    finally:
        for racer in racers:
            racer.stdin.close()
        for racer in racers:
            racer.wait(timeout=40)


EVEN = {"best_probability": 1.0}


@pytest.mark.parametrize("rounds", ROUNDS)
def test_two_simultaneous_assignments_fill_two_equal_cells(database, rounds):
    keys = django(database, f"allocation, count = {EVEN}, {2 * rounds}\n" + PREPARE)
    answers = race(database, keys)
    rows = django(database, COUNT)
    assert Counter(cell for cell, _, _ in rows) == {"all_open": rounds, "shut": rounds}
    assert sorted(number for _, number, _ in rows) == list(range(1, 2 * rounds + 1))
    assert Counter(cell for pair in answers for cell in pair) == {
        "all_open": rounds,
        "shut": rounds,
    }
    assert {stage for _, _, stage in rows} == {"under_way"}


def test_the_last_place_is_given_once_and_a_participant_gets_one_cell(database):
    keys = django(database, "allocation, count = {'quota': 1}, 4\n" + PREPARE)
    answers = race(database, [keys[0], keys[0], keys[1], keys[2], keys[3], keys[3]])
    assert answers[0][0] == answers[0][1]
    assert sorted(answers[1]).count("full") == 1
    assert answers[2] == ["full", "full"]
    assert len(django(database, COUNT)) == 2
