"""Processes that assign participants at the same instant, on real databases: no cell gets more than
another by more than one.
"""

from collections import Counter
from collections.abc import Iterator

import pytest

from tests.support.sessions.races import DATABASES, Racers, racing_on

pytestmark = [pytest.mark.long, pytest.mark.nightly]

ROUNDS = [10, pytest.param(1000, marks=pytest.mark.soak)]
PREPARE = """
from accounts.models import User
from tests.support.studies import participants as p
from tests.support.studies.studies import small_study
from tests.support.studies.task_session import cabin_robot
cabin_robot()
study = p.published(small_study(allocation=allocation))
users = User.objects.bulk_create(User(username=f"visitor-{n}") for n in range(count))
print(json.dumps([str(p.comer(study, user).pk) for user in users]))
"""
READ = """
from django.utils import timezone
from experiments.models import Participant
from experiments.participation import grants
participant = Participant.objects.select_related("study", "user").get(pk=question)
"""
DRAW = """
condition = grants.draw(participant, timezone.now())
print(json.dumps(condition.key if condition is not None else "full"))
"""
COUNT = """
from experiments.models import Draw
rows = list(Draw.objects.values_list("participant__cell", "number", "participant__stage"))
print(json.dumps(rows))
"""


@pytest.fixture(params=DATABASES)
def racers(request, tmp_path) -> Iterator[Racers]:
    with racing_on(request.param, tmp_path) as racers:
        yield racers


def race(racers: Racers, keys: list[str]) -> list[list[str]]:
    """Return the answers to both of two participants who ask at once, for each pair."""
    return [racers.race(READ, DRAW, *keys[n : n + 2]) for n in range(0, len(keys), 2)]


EVEN = {"best_probability": 1.0}


@pytest.mark.parametrize("rounds", ROUNDS)
def test_two_simultaneous_assignments_fill_two_equal_cells(racers, rounds):
    keys = racers.ask(PREPARE, allocation=EVEN, count=2 * rounds)
    answers = race(racers, keys)
    rows = racers.ask(COUNT)
    assert Counter(cell for cell, _, _ in rows) == {"all_open": rounds, "shut": rounds}
    assert sorted(number for _, number, _ in rows) == list(range(1, 2 * rounds + 1))
    assert Counter(cell for pair in answers for cell in pair) == {
        "all_open": rounds,
        "shut": rounds,
    }
    assert {stage for _, _, stage in rows} == {"under_way"}


def test_the_last_place_is_given_once_and_a_participant_gets_one_cell(racers):
    keys = racers.ask(PREPARE, allocation={"quota": 1}, count=4)
    answers = race(racers, [keys[0], keys[0], keys[1], keys[2], keys[3], keys[3]])
    assert answers[0][0] == answers[0][1]
    assert sorted(answers[1]).count("full") == 1
    assert answers[2] == ["full", "full"]
    assert len(racers.ask(COUNT)) == 2
