"""Questionnaires in the database, and those that come with the site."""

import datetime

import msgspec
import pytest

from surveys.definition import from_stored
from surveys.documents import BadDefinitionError
from surveys.models import Questionnaire
from surveys.questionnaires import SHIPPED, current, freeze, next_version, shipped, store
from tests.support.studies.questionnaires import NOW, defined, item

LATER = NOW + datetime.timedelta(days=1)
USABLE = {"ict": 7, "experience": 8, "sus": 10, "tlx": 6}
TEMPLATES = {"godspeed": 24, "presence": 32, "simulator-sickness": 16, "social-presence": 42}


def test_the_site_has_both_forms_of_the_paper_sus_tlx_and_templates():
    known = shipped()
    assert {
        slug: sum(1 for _ in definition.questions()) for slug, definition in known.items()
    } == USABLE | TEMPLATES
    assert {slug for slug, definition in known.items() if definition.template} == set(TEMPLATES)
    assert len(list(SHIPPED.glob("*.json"))) == len(known)


@pytest.mark.parametrize("slug", USABLE)
def test_questionnaires_of_the_site_have_english_spanish_and_a_source(slug):
    definition = shipped()[slug]
    assert definition.languages == ("en", "es")
    assert definition.source
    assert definition.licence
    if slug in {"ict", "experience"}:
        assert "reconstructed" in definition.source


def test_no_form_asks_the_age_which_the_consent_asks():
    for slug in USABLE:
        assert not {"age", "birth_year"} & {one.key for one in shipped()[slug].questions()}, slug


@pytest.mark.parametrize("slug", TEMPLATES)
def test_a_template_holds_no_text_of_the_items(slug):
    for question in shipped()[slug].questions():
        assert "put the text here" in question.text["en"]


def test_the_experience_form_has_values_from_minus_2_and_a_giraff_question():
    definition = shipped()["experience"]
    assert [point.value for point in definition.scales["agreement"]] == [-2, -1, 0, 1, 2]
    assert definition.question("q7").item.show_if.robot == ("giraff",)
    assert sorted(key for topic in definition.topics for key in topic.items) == [
        f"q{n}" for n in range(1, 9)
    ]


@pytest.mark.django_db
def test_a_questionnaire_comes_into_the_database_once_and_comes_out_equal():
    row = current("sus", NOW)
    assert current("sus", LATER) == row
    assert from_stored(Questionnaire.objects.get().definition) == shipped()["sus"]
    with pytest.raises(Questionnaire.DoesNotExist):
        current("nobody", NOW)


@pytest.mark.django_db
def test_a_draft_can_be_replaced_and_what_is_in_use_cannot():
    first = store(defined([item("text", "a")]), NOW)
    assert store(defined([item("text", "b")]), LATER).pk == first.pk
    frozen = freeze(Questionnaire.objects.get(), NOW)
    assert frozen.frozen_at == NOW
    with pytest.raises(BadDefinitionError, match="in use and cannot change"):
        store(defined([item("text", "c")]), LATER)
    assert store(defined([item("text", "b")]), LATER) == frozen
    assert freeze(frozen, LATER).frozen_at == NOW
    assert [
        question.key for question in Questionnaire.objects.get().as_definition().questions()
    ] == ["b"]


@pytest.mark.django_db
def test_a_new_version_is_a_copy_after_the_newest():
    first = freeze(store(defined([item("text", "a")]), NOW), NOW)
    second = next_version(first, LATER)
    assert (second.version, second.frozen_at) == (2, None)
    assert next_version(first, LATER).version == 3
    assert current("test", LATER).version == 3


@pytest.mark.django_db
def test_a_template_cannot_be_used_until_its_text_is_filled_in():
    row = current("godspeed", NOW)
    with pytest.raises(BadDefinitionError, match="is a template"):
        freeze(row, NOW)
    assert (
        freeze(
            store(msgspec.structs.replace(row.as_definition(), template=False), NOW), NOW
        ).frozen_at
        == NOW
    )


@pytest.mark.django_db
def test_a_wrong_questionnaire_is_not_stored():
    with pytest.raises(BadDefinitionError, match="no page"):
        store(msgspec.structs.replace(shipped()["sus"], pages=()), NOW)
    assert not Questionnaire.objects.exists()
