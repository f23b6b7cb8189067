"""Where a response was asked: columns, read once from the contexts of older databases."""

import pytest
from django.db import connection
from django.db.migrations.executor import MigrationExecutor
from django.utils import timezone

from experiments.models import StepResponse
from experiments.participation.drive_status import DriveStatus
from experiments.participation.journey import JourneyPlace
from experiments.participation.questions import ask
from tests.support.people import person
from tests.support.studies import participants as p

BEFORE = [("experiments", "0006_drive_ends")]


@pytest.fixture
def study():
    return p.published(p.of("exploration"))


@pytest.fixture
def participant(study):
    return p.comer(study, person())


def asked(study, participant, visit: int, step: str) -> StepResponse:
    definition = study.as_definition()
    response = ask(
        participant,
        JourneyPlace(visit, 0, step),
        definition.step(step),
        drive=DriveStatus(),
        now=timezone.now(),
    )
    return StepResponse.objects.get(response=response)


def places() -> list[tuple]:
    columns = ("response", "participant", "visit", "round", "step")
    return sorted(StepResponse.objects.values_list(*columns), key=str)


@pytest.mark.django_db
def test_a_response_has_one_place(study, participant):
    first = asked(study, participant, 2, "experience")
    assert asked(study, participant, 2, "experience") == first
    assert (first.visit, first.round, first.step) == (2, 0, "experience")


@pytest.mark.nightly
@pytest.mark.django_db(transaction=True)
def test_places_come_from_older_databases_and_nothing_is_lost_on_the_way_back(study, participant):
    asked(study, participant, 1, "experience")
    asked(study, participant, 2, "experience")
    known = places()
    assert len(known) == 2
    newest = MigrationExecutor(connection).loader.graph.leaf_nodes()
    try:
        MigrationExecutor(connection).migrate(BEFORE)
        assert StepResponse._meta.db_table not in connection.introspection.table_names()
    finally:  # the next tests have this database, too
        MigrationExecutor(connection).migrate(newest)
    assert places() == known
