"""Which profile of the drive page suits somebody, by what they answered about their use of
computers and games.
"""

import datetime

import pytest

from experiments.interface_suggestion import suggested_to, suits
from sessions import interfaces
from surveys.questionnaires import store
from surveys.responses import Context, Respondent, Saving, begin, finish, save_one
from tests.support.people import person
from tests.support.studies.questionnaires import NOW, defined, item

LATER = NOW + datetime.timedelta(days=1)


@pytest.mark.parametrize(
    ("use", "profile"),
    [
        ({"computer": 4, "games": 3, "smartphone": 0}, "expert"),
        ({"computer": 3, "games": 4}, "expert"),
        ({"computer": 4, "games": 2}, "novice"),
        ({"computer": 0, "games": 4}, "novice"),
        ({"games": 4}, "novice"),
        ({"computer": 0, "games": None}, "novice"),
        ({"computer": None, "games": None}, None),
        ({"smartphone": 4}, None),
        ({}, None),
    ],
)
def test_the_profile_follows_from_how_often_somebody_uses_computers_and_plays(use, profile):
    assert suits(use) == profile


def answered(who, *, context, now, done=True, **use):
    definition = defined([item("number", key, minimum=0.0, maximum=4.0) for key in use], slug="ict")
    response = begin(
        store(definition, NOW),
        Respondent(user=who),
        Context(key=context),
        language="en",
        seed=1,
        now=now,
    )
    for key, value in use.items():
        save_one(response, definition, key, {key: [str(value)]}, Saving(now=now, language="en"))
    if done:
        finish(response, definition, now)


@pytest.mark.django_db
def test_the_newest_finished_answers_count_and_only_ones_own():
    anna, bert = person("anna"), person("bert")
    assert suggested_to(anna) is None
    answered(anna, context="first", now=NOW, computer=0, games=0)
    assert suggested_to(anna) == "novice"
    answered(anna, context="second", now=LATER, computer=4, games=4)
    assert suggested_to(anna) == "expert"
    answered(
        anna,
        context="third",
        now=LATER + datetime.timedelta(days=1),
        done=False,
        computer=0,
        games=0,
    )
    assert suggested_to(anna) == "expert"
    assert suggested_to(bert) is None


@pytest.mark.django_db
def test_the_drive_page_hears_of_it_from_the_app_that_knows_the_answers():
    anna = person("anna")
    answered(anna, context="first", now=NOW, computer=4, games=4)
    assert interfaces.suggested_to(anna) == "expert"
    assert interfaces.suggested_to(person("bert")) is None
