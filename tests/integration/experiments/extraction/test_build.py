"""A study in the database becomes the dataset that was stored, under pseudonyms and without any
identity.
"""

import datetime
from dataclasses import replace

import numpy as np
import pytest
from django.utils import timezone

from experiments.analysis.report import reports
from experiments.dataset.columns import matrix_of
from experiments.extraction.build import dataset_of
from experiments.extraction.selection import Selection
from experiments.models import Drive, Participant
from experiments.participation.drive_status import DriveStatus
from experiments.participation.journey import JourneyPlace
from experiments.participation.questions import ask
from tests.support.analysis.study_dataset import made_up
from tests.support.people import person
from tests.support.studies import participants as p
from tests.support.studies.study_rows import put

pytestmark = pytest.mark.django_db


@pytest.fixture
def both():
    """A dataset, and the one that is extracted from the database after storing it."""
    made = made_up(np.random.default_rng(71), 12)
    closed = {one.key: tuple(sorted(one.doors_closed)) for one in made.study.conditions}
    made = replace(
        made,
        sessions=tuple(replace(one, doors_closed=closed[one.condition]) for one in made.sessions),
    )
    stored = put(made)
    return made, stored, dataset_of(stored.study)


def test_sessions_are_extracted_unchanged_but_for_their_names(both):
    made, _, found = both
    assert len(found.sessions) == len(made.sessions)
    for before, after in zip(made.sessions, found.sessions, strict=True):
        assert after.id not in {one.id for one in made.sessions}
        for name in (
            "participant",
            "robot",
            "number",
            "condition",
            "site",
            "outcome",
            "os",
            "browser",
            "operator",
            "practice",
            "doors_closed",
        ):
            assert getattr(after, name) == getattr(before, name), name
        for name in ("first_frame", "first_motion", "ended"):
            np.testing.assert_allclose(getattr(after, name), getattr(before, name), atol=2e-6)


def test_states_and_network_are_extracted_unchanged_with_any_clocks(both):
    made, _, found = both
    for before, after in zip(made.sessions, found.sessions, strict=True):
        states, expected, network = (
            found.states(after.id),
            made.states(before.id),
            found.network(after.id),
        )
        for name in expected.dtype.names:
            if name == "received":  # known for a chunk, not for each of its states
                continue
            counts = slice(None) if name != "age_max" else expected["commands"] > 0
            np.testing.assert_allclose(states[name][counts], expected[name][counts], atol=2e-6)
        np.testing.assert_allclose(
            matrix_of(network), matrix_of(made.network(before.id)), atol=2e-6
        )


@pytest.mark.nightly
def test_people_pages_answers_and_events_are_extracted_unchanged(both):
    made, _, found = both
    derived = {"left": "", "age": 0.0, "age_band": "", "first_cell": "", "stage": ""}
    assert [replace(one, **derived) for one in found.participants] == [
        replace(one, **derived) for one in made.participants
    ]
    assert {(one.participant, one.step, one.finished) for one in found.pages} == {
        (one.participant, one.step, one.finished) for one in made.pages
    }
    codes = {
        before.id: after.id for before, after in zip(made.sessions, found.sessions, strict=True)
    } | {"": ""}
    given = {
        (one.questionnaire, one.participant, one.session): dict(one.values)
        for one in found.responses
    }
    assert given == {
        (one.questionnaire, one.participant, codes[one.session]): dict(one.values)
        for one in made.responses
    }
    assert len(found.events) == len(made.events)
    assert found.plans == made.plans


@pytest.mark.nightly
def test_tables_of_extracted_and_stored_dataset_are_the_same(both):
    made, _, found = both
    (before,), (after,) = reports(made), reports(found)
    for first, second in zip(before.tables, after.tables, strict=True):
        if first.name in {"table-1", "sessions", "segments", "flow", "reporting-sheet"}:
            continue
        assert [[cell.text for cell in row] for row in first.rows] == [
            [cell.text for cell in row] for row in second.rows
        ], first.name


@pytest.fixture
def practised_twice() -> Participant:
    """A participant who had to repeat the practice, and then left the task."""
    robot, study = p.site(), p.published(p.of("assistance"))
    one = p.assign(p.comer(study, person()), "alone", "assisted")
    for step, number, outcome in (
        ("practice", 1, "connection_refused"),
        ("practice", 2, "completed"),
        ("task", 1, "cancelled"),
    ):
        Participant.objects.filter(pk=one.pk).update(step=step)
        one.refresh_from_db()
        p.drive_of(robot, one, outcome=outcome, moved=True, number=number)
    return one


def test_drives_are_in_the_order_of_time_although_each_step_counts_its_own(practised_twice):
    dataset = dataset_of(practised_twice.study)
    outcomes = [one.outcome for one in dataset.sessions]
    assert outcomes == ["connection_refused", "completed", "cancelled"]
    assert dataset.participants[0].left == "cancelled", "not the outcome of the second practice"


@pytest.mark.parametrize(("outcome", "left"), [("cancelled", ""), ("robot_fault", "robot_fault")])
def test_ending_the_voluntary_practice_is_no_reason_for_leaving(practised_twice, outcome, left):
    Drive.objects.filter(step="task").delete()
    Drive.objects.filter(number=2).update(outcome=outcome)
    assert dataset_of(practised_twice.study).participants[0].left == left


@pytest.mark.parametrize(("public", "time"), [(False, "2026-05-04 10:07"), (True, "2026-05-04")])
def test_a_drive_that_a_researcher_excluded_has_the_time_of_that(practised_twice, public, time):
    at = datetime.datetime(2026, 5, 4, 10, 7, 33, tzinfo=datetime.UTC)
    drives = Drive.objects.filter(step="task")
    drives.update(excluded_reason="a test", excluded_at=at)
    sessions = dataset_of(practised_twice.study, choice=Selection(public=public)).sessions
    found = [(one.excluded, one.excluded_at) for one in sessions]
    assert found == [("", ""), ("", ""), ("a test", time)]


def test_answers_after_a_repeated_practice_are_about_the_task(practised_twice):
    one, study = practised_twice, practised_twice.study
    place = JourneyPlace(1, 0, "workload")
    asked = study.as_definition().step("workload")
    ask(one, place, asked, drive=DriveStatus(), now=timezone.now())
    dataset = dataset_of(study)
    (task,) = (one.id for one in dataset.sessions if not one.practice)
    assert [one.session for one in dataset.responses] == [task]
