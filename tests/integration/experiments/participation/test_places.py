"""The places of a study as they count now: who left before they had every condition gives theirs to
another, and gets it back on returning.
"""

import pytest

from experiments.models import Participant
from experiments.participation import places
from robots.models import Robot
from tests.support.people import person
from tests.support.studies import participants as p

pytestmark = pytest.mark.django_db
ORDERS = (("alone", "assisted"), ("assisted", "alone"))


@pytest.fixture
def robot() -> Robot:
    return p.site()


@pytest.fixture
def study(robot):
    return p.published(p.of("assistance"))


def participant_of(study, robot, name, order, rounds):
    """A participant who drove some of their conditions."""
    found = p.assign(p.comer(study, person(name)), *order)
    task = study.as_definition().task.key
    for number in range(rounds):
        Participant.objects.filter(pk=found.pk).update(round=number, step=task)
        p.drive_of(robot, found, outcome="completed", moved=True, step=task)
    Participant.objects.filter(pk=found.pk).update(stage="filled")
    found.refresh_from_db()
    return found


def stages(study, now=None):
    found = places.held(study, "participant", now or p.later(0))
    return sorted((one.cell, one.stage) for one in found)


def test_participant_silent_after_the_first_round_has_left_until_they_return(study, robot):
    participant_of(study, robot, "ada", ORDERS[0], 1)
    participant_of(study, robot, "ben", ORDERS[1], 2)
    assert stages(study) == [("alone-assisted", "filled"), ("assisted-alone", "filled")]
    later = p.later(25 * 3600)
    assert stages(study, later) == [("alone-assisted", "left"), ("assisted-alone", "filled")]
    Participant.objects.update(seen_at=later)
    assert stages(study, later) == [("alone-assisted", "filled"), ("assisted-alone", "filled")]


@pytest.mark.parametrize(("status", "rounds"), [("withdrawn", 2), ("finished", 1)])
def test_withdrawing_or_finishing_without_every_condition_is_leaving_at_once(
    study, robot, status, rounds
):
    one = participant_of(study, robot, "ada", ORDERS[0], rounds)
    Participant.objects.filter(pk=one.pk).update(status=status)
    assert stages(study) == [("alone-assisted", "left")]


def test_a_drive_that_is_not_settled_yet_counts(study, robot):
    one = participant_of(study, robot, "ada", ORDERS[0], 2)
    one.drives.filter(number=2).update(moved=False, settled_at=None)
    Participant.objects.filter(pk=one.pk).update(status="finished")
    assert stages(study) == [("alone-assisted", "filled")]


def test_how_long_the_study_waits_is_its_own_to_say(robot):
    allocation = {"design": "within", "left_after_hours": 200.0}
    study = p.published(p.of("assistance", allocation=allocation))
    participant_of(study, robot, "ada", ORDERS[0], 1)
    assert stages(study, p.later(199 * 3600)) == [("alone-assisted", "filled")]
    assert stages(study, p.later(201 * 3600)) == [("alone-assisted", "left")]


def test_participant_who_drove_keeps_the_place_after_months(robot):
    study = p.published(p.of("exploration"))
    participant_of(study, robot, "ada", ("giraff_open",), 1)
    assert stages(study, p.later(90 * 86400)) == [("giraff_open", "filled")]


def test_a_reader_of_own_instructions_who_never_drove_is_gone_after_a_while(robot):
    steps = p.msgspec.to_builtins(p.of("exploration"))["steps"]
    read = next(one for one in steps if one["kind"] == "instructions")
    read["leaves"][0]["conditions"] = ["giraff_open"]
    study = p.published(p.of("exploration", steps=steps))
    p.assign(p.comer(study, person("ada")), "giraff_open")
    assert stages(study) == [("giraff_open", "under_way")]
    assert stages(study, p.later(25 * 3600)) == [("giraff_open", "left")]


def test_a_bot_or_pilot_is_counted_with_their_own_kind(study, robot):
    participant_of(study, robot, "ada", ORDERS[0], 1)
    assert places.held(study, "pilot", p.later(0)) == []
