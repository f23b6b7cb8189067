from importlib import import_module

import pytest
from django.apps import apps

from experiments.models import Participant
from experiments.recruitment import recognition
from experiments.recruitment.quality import same_id_flags
from experiments.recruitment.sites import Arrival
from tests.support.people import person
from tests.support.studies import participants as p

pytestmark = pytest.mark.django_db


def test_earlier_participants_with_one_id_are_flagged_and_the_first_is_recognized():
    study = p.published(p.of("exploration"))
    came = ("5f0c", "5f0c", "b0b", "", "%PID%")
    people = [p.comer(study, person(f"p{n}")) for n in range(len(came))]
    for one, identifier in zip(people, came, strict=True):
        given = {"PROLIFIC_PID": identifier} if identifier else {}
        Participant.objects.filter(pk=one.pk).update(recruitment=given)
    import_module("experiments.migrations.0015_recruitment").fill_in(apps, None)
    first = recognition.known(study, Arrival("prolific", "5f0c"))
    assert first == people[0]
    assert list(
        Participant.objects.order_by("created_at").values_list("recruitment_id", flat=True)
    ) == [
        "5f0c",
        "5f0c",
        "b0b",
        "",
        "",
    ]
    assert len(set(Participant.objects.values_list("recruited_as", flat=True))) == len(came)
    flagged = {one.participant for one in same_id_flags(study)}
    assert flagged == {people[0].code, people[1].code}
