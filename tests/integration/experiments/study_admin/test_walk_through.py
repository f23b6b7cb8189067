"""A researcher looks at every page of a study as its participants see it."""

import pytest
from django.apps import apps
from django.urls import reverse
from django.utils import timezone

from experiments import publishing
from experiments.definition.shipped import shipped
from experiments.participation import journey
from tests.integration.experiments.test_publishing import NOW
from tests.support.browsers.html_page import faults, read
from tests.support.people import person
from tests.support.studies import participants as p
from tests.support.studies.members import signed_in
from tests.support.studies.studies import small_study

pytestmark = pytest.mark.django_db


def rows() -> dict[str, int]:
    """How many rows there are of everything but browser sessions."""
    return {
        model.__name__: model.objects.count()
        for model in apps.get_models()
        if model.__name__ != "Session" or hasattr(model, "visitor")
    }


def frame(study, **query) -> str:
    address = reverse("admin:experiments_study_walk_through", args=[study.pk])
    return address + "?" + "&".join(f"{name}={value}" for name, value in query.items())


def step(study, number: int, language: str = "en") -> str:
    return reverse("admin:experiments_study_walked_step", args=[study.pk, language, number])


@pytest.mark.parametrize("name", list(shipped()))
@pytest.mark.parametrize("language", ["en", "es"])
def test_every_step_is_seen_in_every_language_and_nothing_is_saved(client, name, language):
    study = publishing.store(p.of(name), timezone.now())
    signed_in(client, "viewer", study.slug)
    definition = study.as_definition()
    route = journey.route(definition, journey.rounds(definition, "open"), 1)
    before = rows()
    for number, place in enumerate(route, start=1):
        answer = client.get(step(study, number, language))
        assert answer.status_code == 200
        page = read(answer)
        assert faults(page) == []
        word = {"en": "Step", "es": "Paso"}[language]
        assert page.all("title")[0].text.strip().startswith(f"{word} {number} "), place.word
        assert page.all("html")[0].attributes["lang"] == language
        assert definition.title[language] in page.all("main")[0].text
        sent = client.post(step(study, number, language), {"age": "3", "agree": ""})
        assert sent.url == step(study, min(number + 1, len(route)), language)
    assert rows() == before


def test_the_frame_offers_every_language_and_the_width_of_a_phone(client):
    study = publishing.store(p.of("exploration"), timezone.now())
    signed_in(client, "viewer", study.slug)
    page = read(client.get(frame(study)))
    screen = page.all("iframe")[0].attributes
    assert (screen["width"], screen["src"]) == ("390", step(study, 1))
    page = read(client.get(frame(study, language="es", width="computer")))
    screen = page.all("iframe")[0].attributes
    assert (screen["width"], screen["src"]) == ("1280", step(study, 1, "es"))
    assert len([e for e in page.all("a") if e.attributes.get("target")]) == 6
    assert {"English", "Spanish"} <= {e.text for e in page.all("a")}
    third = read(client.get(frame(study, step="instructions"))).all("iframe")[0].attributes
    assert third["src"] == step(study, 3)
    assert read(client.get(frame(study, language="xx", width="wall"))).all("iframe")


def test_the_builder_links_to_the_walk_through(client):
    study = publishing.store(p.of("exploration"), timezone.now())
    signed_in(client, "viewer", study.slug)
    whole = reverse("admin:experiments_study_walk_through", args=[study.pk])
    built = reverse("admin:experiments_study_part", args=[study.pk, "steps", 2])
    overview = reverse("admin:experiments_study_change", args=[study.pk])
    for address, route in (
        (built, f"{whole}?step=instructions"),
        (built, whole),
        (overview, whole),
    ):
        assert route in [e.attributes.get("href") for e in read(client.get(address)).all("a")]
    current = [e.text for e in read(client.get(whole)).all("a") if "aria-current" in e.attributes]
    assert current[:2] == ["Builder", "Walk through"]


def test_a_walk_through_of_one_condition_stays_in_it(client):
    steps = p.msgspec.to_builtins(p.of("exploration"))["steps"]
    pages = next(one for one in steps if one["kind"] == "instructions")["leaves"]
    pages[0]["conditions"] = ["giraff_open"]
    study = publishing.store(p.of("exploration", steps=steps), timezone.now())
    signed_in(client, "viewer", study.slug)
    before = rows()

    def seen(condition: str) -> str:
        page = read(client.get(frame(study, condition=condition, step="instructions")))
        shown = page.all("iframe")[0].attributes["src"]
        following = client.post(shown).url
        assert following.endswith(f"/4/{condition}/" if condition else "/4/")
        return read(client.get(shown)).text

    assert "Page 1 of 4" in seen("giraff_open")
    assert "Page 1 of 3" in seen("giraff_lab_closed")
    assert "Page 1 of 4" in seen("")
    assert client.get(step(study, 3) + "nobody/").status_code == 404
    assert rows() == before


def test_questions_look_as_participants_see_them_and_save_nothing(client):
    study = publishing.store(p.of("assistance"), timezone.now())
    signed_in(client, "viewer", study.slug)
    scripts = [e.attributes.get("src", "") for e in read(client.get(step(study, 6))).all("script")]
    assert any("survey/look" in one for one in scripts)
    assert not any("survey/page" in one for one in scripts)


def test_its_pages_are_shown_in_a_frame_of_this_site_and_of_no_other(client):
    study = publishing.store(p.of("exploration"), timezone.now())
    signed_in(client, "viewer", study.slug)
    answer = client.get(step(study, 1))
    assert answer["X-Frame-Options"] == "SAMEORIGIN"
    assert "frame-ancestors 'self'" in answer["Content-Security-Policy"]


def test_a_questionnaire_of_several_pages_leads_from_one_to_the_next(client):
    study = publishing.store(p.of("exploration"), timezone.now())
    signed_in(client, "viewer", study.slug)
    page = read(client.get(step(study, 5) + "?page=99"))
    assert faults(page) == []
    following = [e.attributes.get("href") for e in page.all("a")]
    if "?page=2" in following:
        assert faults(read(client.get(step(study, 5) + "?page=2"))) == []


def test_an_unfinished_draft_can_be_walked_through_as_far_as_it_goes(client):
    study = publishing.begin_empty("mine", "My study", ["en", "es"], NOW)
    signed_in(client, "viewer", study.slug)
    before = rows()
    for number in range(1, 7):
        answer = client.get(step(study, number))
        assert answer.status_code == 200
        assert faults(read(answer)) == []
    assert "The instructions have no pages." in read(client.get(step(study, 3))).text
    assert "[[institution]]" in read(client.get(step(study, 1))).text
    assert rows() == before


@pytest.mark.parametrize(("number", "language"), [(0, "en"), (99, "en"), (1, "xx")])
def test_steps_and_languages_that_a_study_lacks_are_not_found(client, number, language):
    study = publishing.store(small_study(), NOW)
    signed_in(client, "viewer", study.slug)
    assert client.get(step(study, number, language)).status_code == 404


def test_the_studies_of_others_are_not_there(client):
    study = publishing.store(small_study(), NOW)
    client.force_login(person("other", is_staff=True))
    assert client.get(step(study, 1)).status_code == 404
    assert client.get(frame(study)).status_code == 404
