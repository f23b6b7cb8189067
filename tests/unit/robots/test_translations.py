"""Titles of robots and places by language, without a database."""

import json

import pytest
from django.conf import settings
from django.core.exceptions import ValidationError
from django.utils import translation

from robots.api import floorplan
from robots.models import FloorPlan, check_translations
from tests.support.robots import unsaved_robot

SPANISH = {"es": {"title": "Jirafa", "description": "Un robot esbelto."}}
PLANS = settings.BASE_DIR / "robots" / "world" / "plans"


def robot(**fields):
    return unsaved_robot(
        **{"name": "giraff", "title": "Giraff", "description": "A slender robot.", **fields}
    )


@pytest.mark.parametrize(
    ("language", "title", "description"),
    [
        ("en", "Giraff", "A slender robot."),
        ("es", "Jirafa", "Un robot esbelto."),
        ("es-mx", "Jirafa", "Un robot esbelto."),
    ],
)
def test_a_robot_is_called_and_described_in_the_language_of_the_page(language, title, description):
    found = robot(translations=SPANISH)
    with translation.override(language):
        assert (found.shown_title, found.shown_description) == (title, description)
    assert found.titles == {"es": "Jirafa"}


def test_a_text_without_a_translation_is_shown_untranslated():
    with translation.override("es"):
        found = robot(translations={"es": {"description": "Un robot esbelto."}})
        assert (found.shown_title, found.shown_description) == ("Giraff", "Un robot esbelto.")
        assert robot().shown_title == "Giraff"
        assert robot(title="").shown_title == "giraff"


@pytest.mark.parametrize(
    "wrong",
    [
        [],
        {"es": "Jirafa"},
        {"Spanish": {"title": "Jirafa"}},
        {"es": {"name": "jirafa"}},
        {"es": {"title": ""}},
        {"es": {"title": 7}},
        {"es": {"title": "J" * 81}},
    ],
)
def test_translations_of_another_form_are_refused_with_the_form_they_should_have(wrong):
    with pytest.raises(ValidationError, match="Enter translations like this"):
        check_translations(wrong)
    check_translations(SPANISH)
    check_translations({})


def test_robots_receive_plans_without_translations():
    plan = json.loads((PLANS / "office" / "plan.json").read_text())
    picture = {"resolution": 0.05, "origin_x": 0.0, "origin_y": 0.0, "image": b""}
    place = FloorPlan(name="office", title="Office", sha256="0" * 64, plan=plan, **picture)
    sent = place.as_message().plan
    assert "translations" in plan
    assert sent == {name: part for name, part in plan.items() if name != "translations"}
    with translation.override("es"):
        assert place.shown_title == "Oficina"
    with translation.override("en"):
        assert place.shown_title == "Office"


def titles(value):
    if isinstance(value, dict):
        yield from [value["title"]] if isinstance(value.get("title"), str) else []
        for part in value.values():
            yield from titles(part)
    elif isinstance(value, list):
        for part in value:
            yield from titles(part)


@pytest.mark.parametrize("site", sorted(path.name for path in PLANS.iterdir() if path.is_dir()))
def test_every_title_of_a_site_that_we_ship_has_its_spanish(site):
    plan = json.loads((PLANS / site / "plan.json").read_text())
    floorplan.decode(json.dumps(plan))
    assert set(titles(plan)) - {""} == set(plan["translations"]["es"])
