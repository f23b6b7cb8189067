"""The editor: a questionnaire made page by page, without JSON and without JavaScript."""

import pytest
from django.contrib.auth.models import Permission
from django.urls import reverse

from experiments import publishing, resources
from surveys.documents import BadDefinitionError
from surveys.models import Questionnaire
from surveys.questionnaires import freeze, is_usable, problems_of, shipped, store
from surveys.questions import TYPES
from tests.support.browsers.html_page import faults, read
from tests.support.people import person
from tests.support.studies.questionnaires import NOW, defined, item, rows
from tests.support.studies.study_pages import form_of

pytestmark = [pytest.mark.django_db, pytest.mark.usefixtures("researcher")]


def at(row: Questionnaire, *place: str) -> str:
    name = ("editor", "section", "part")[len(place)]
    return reverse(f"admin:surveys_questionnaire_{name}", args=[row.pk, *place])


def stored():
    return Questionnaire.objects.get().as_definition()


def press(client, row: Questionnaire, do: str):
    """Press a button of the overview."""
    sha256 = Questionnaire.objects.get(pk=row.pk).sha256
    return client.post(at(row), {"do": do, "sha256": sha256})


def send(client, address: str, do: str = "save", **changes):
    """Fill in the form of a page and press one of its buttons."""
    data = form_of(client.get(address))
    data["do"] = do
    for name, value in changes.items():
        known = name.replace("__", ".")
        data.setlist(known, value) if isinstance(value, list) else data.update({known: value})
    return client.post(address, dict(data.lists()))


@pytest.fixture
def row(client):
    """A draft in two languages, just begun."""
    sent = {"title": "The doors", "languages": ["en", "es"]}
    answer = client.post(reverse("admin:surveys_questionnaire_write"), sent)
    found = Questionnaire.objects.get()
    assert answer.headers["Location"] == at(found)
    return found


def texts(name: str, text: str) -> dict[str, str]:
    return {f"{name}__{language}": f"{text} ({language})" for language in ("en", "es")}


def test_a_questionnaire_is_written_from_empty_until_a_study_can_use_it(client, row):
    assert (row.slug, row.version, len(row.as_definition().questions())) == ("the-doors", 1, 1)
    assert not is_usable(row)
    send(client, at(row, "questions", "q1"), **texts("text", "Why?"))
    answer = press(client, row, "add:questions:page_1:grid")
    assert answer.headers["Location"] == at(row, "questions", "q2")
    statements = texts("rows__0__text", "Easy") | texts("rows__1__text", "Fun")
    answer = send(client, at(row, "questions", "q2"), **texts("text", "Driving was"), **statements)
    assert answer.headers["Location"] == at(row, "questions", "q2")
    assert [str(point.value) for point in stored().scales["agreement_5"]] == list("12345")
    assert stored().scales["agreement_5"][0].label["es"] == "Muy en desacuerdo"
    press(client, row, "add:questions:page_1:single")
    send(client, at(row, "questions", "q3"), "add:options")
    labels = {}
    for n, label in enumerate(("Yes", "No", "Sometimes")):
        labels |= texts(f"options__{n}__label", label)
    send(client, at(row, "questions", "q3"), required="on", **texts("text", "Again?"), **labels)
    assert [one.value for one in stored().question("q3").item.options][1] == "no_en"
    assert is_usable(Questionnaire.objects.get())
    assert ("the-doors", 1) in resources.known_here().questionnaires
    assert "Complete: a study can use it" in read(client.get(at(row))).text


def test_a_question_depends_on_the_answer_to_an_earlier_one(client, row):
    press(client, row, "add:questions:page_1:likert")
    press(client, row, "add:questions:page_1:number")
    page = at(row, "questions", "q3")
    send(client, page, show_if__on="on", show_if__item="q2")
    boxes = read(client.get(page)).all("input")
    assert [e.attributes["value"] for e in boxes if e.attributes.get("name") == "show_if.is"] == [
        *"12345"
    ]
    send(client, page, show_if__is=["4", "5"], maximum="this_year")
    condition = stored().question("q3").item.show_if
    assert (condition.item, condition.one_of) == ("q2", (4, 5))
    assert stored().question("q3").item.maximum == "this_year"
    assert "only in some cases" in read(client.get(at(row))).text
    send(client, page, show_if__item="q1", show_if__robot="giraff, the other one")
    condition = stored().question("q3").item.show_if
    assert (condition.one_of, condition.robot) == ((), ("giraff", "the other one"))


@pytest.mark.parametrize("kind", TYPES)
def test_a_question_of_every_type_has_a_page(client, row, kind):
    press(client, row, f"add:questions:page_1:{kind}")
    page = at(row, "questions", "q2")
    assert faults(read(client.get(page))) == []
    assert faults(read(client.get(at(row)))) == []
    before = Questionnaire.objects.get().sha256
    assert send(client, page).status_code == 302
    assert Questionnaire.objects.get().sha256 == before
    preview = reverse("admin:surveys_questionnaire_preview", args=[row.pk])
    assert client.get(preview).status_code == 200


def test_an_incomplete_draft_is_kept_and_never_used(client, row):
    with pytest.raises(BadDefinitionError):
        freeze(row, NOW)
    assert (row.slug, 1) not in resources.known_here().questionnaires
    messages = [e.text for e in read(client.get(at(row, "questions", "q1"))).all("li")]
    assert "Text (English, Spanish) is missing." in messages
    listed = read(client.get(reverse("admin:surveys_questionnaire_changelist"))).text
    assert "draft, incomplete" in listed
    assert "English, Spanish" in listed


def test_of_two_who_write_at_once_the_second_is_refused_and_loses_nothing(client, row):
    page = at(row, "questions", "q1")
    sent = dict(form_of(client.get(page)).lists()) | {"text.en": "Mine", "do": "save"}
    send(client, page, text__en="Theirs")
    answer = client.post(page, sent)
    shown = read(answer)
    assert answer.status_code == 422
    assert "someone else changed this draft" in shown.text
    assert [e.text.strip() for e in shown.all("textarea") if e.attributes["name"] == "text.en"] == [
        "Mine"
    ]
    assert stored().question("q1").text["en"] == "Theirs"
    again = dict(form_of(answer).lists()) | {"do": "save"}
    assert client.post(page, again).status_code == 302
    assert stored().question("q1").text["en"] == "Mine"
    press(client, row, "remove:questions:q1")
    answer = client.post(page, again)
    assert "someone else removed this question" in read(answer).text
    assert "Mine" in answer.content.decode()
    stale = client.post(at(row), {"do": "add:pages", "sha256": row.sha256}, follow=True)
    assert "someone else changed" in read(stale).text


def test_pages_questions_and_scales_are_added_moved_and_removed(client, row):
    press(client, row, "add:pages")
    press(client, row, "down:questions:q1")
    assert [len(page.items) for page in stored().pages] == [0, 1]
    press(client, row, "remove:pages:page_1")
    press(client, row, "copy:questions:q1")
    press(client, row, "remove:pages:page_2")
    assert [page.key for page in stored().pages] == ["page_2"]
    assert press(client, row, "add:scales").headers["Location"] == at(row, "scales", "scale_1")
    labels = {"points__0__label__en": "Hard", "points__1__label__en": "Easy"}
    scale = at(row, "scales", "scale_1")
    send(client, scale, "add:points", **labels)
    send(client, scale, "up:points:1")
    assert [(one.value, one.label.get("en")) for one in stored().scales["scale_1"]] == [
        (1, "Easy"),
        (2, "Hard"),
        (3, None),
    ]
    assert faults(read(client.get(at(row)))) == []
    press(client, row, "remove:scales:scale_1")
    press(client, row, "add:scales::agreement_7")
    assert list(stored().scales) == ["agreement_7"]


def test_a_scale_is_removed_alone_though_a_question_has_its_name(client, row):
    press(client, row, "add:scales")
    send(client, at(row, "questions", "q1"), key="scale_1")
    press(client, row, "remove:scales:scale_1")
    assert stored().scales == {}
    assert [question.key for question in stored().questions()] == ["scale_1"]


def test_options_are_moved_and_removed_on_the_page_of_their_question(client, row):
    press(client, row, "add:questions:page_1:ranking")
    page = at(row, "questions", "q2")
    labels = {"options__0__label__en": "Hear", "options__1__label__en": "See"}
    send(client, page, "add:options", **labels, options__2__label__en="Drive")
    for do, left in (
        ("up:options:1", ["see", "hear", "option_1"]),
        ("remove:options:9", ["see", "hear", "option_1"]),
        ("burn:options:0", ["see", "hear", "option_1"]),
        ("remove:options:2", ["see", "hear"]),
    ):
        assert send(client, page, do).status_code == 302
        assert [option.value for option in stored().question("q2").item.options] == left


def test_a_title_in_only_one_language_is_reported_at_its_page(client, row):
    page = at(row, "pages", "page_1")
    send(client, page, title__en="The doors")
    messages = [e.text for e in read(client.get(page)).all("li")]
    assert "Title (Spanish) is missing." in messages
    assert not is_usable(Questionnaire.objects.get())


def test_a_refused_value_is_reported_beside_its_field(client, row):
    press(client, row, "add:questions:page_1:number")
    page = at(row, "questions", "q2")
    answer = send(client, page, minimum="few", key="No Key")
    assert answer.status_code == 422
    messages = [e.text for e in read(answer).all("li")]
    assert "This is not a number." in messages
    assert [e for e in read(answer).all("details") if "open" in e.attributes]
    assert stored().question("q2").item.minimum is None


@pytest.mark.parametrize(
    ("place", "sent", "message"),
    [
        (("questions", "q2"), {"step": "2.5"}, "Write a whole number."),
        (("questions", "q2"), {"step": "0"}, "Write a number of at least 1."),
        (("about",), {"languages": []}, "Choose at least one language."),
    ],
)
def test_invalid_value_has_an_error_with_the_valid_form(client, row, place, sent, message):
    press(client, row, "add:questions:page_1:slider")
    before = stored()
    answer = send(client, at(row, *place), **sent)
    assert answer.status_code == 422
    assert message in [e.text for e in read(answer).all("li")]
    assert stored() == before


def test_the_questionnaire_itself_has_a_form(client, row):
    page = at(row, "about")
    assert faults(read(client.get(page))) == []
    send(client, page, "add:topics", intro__en="Welcome", scoring="topics")
    assert (stored().intro, stored().topics[0].key) == ({"en": "Welcome"}, "topic_1")
    send(client, page, languages=["en"])
    assert stored().languages == ("en",)
    assert set(stored().title) == {"en"}
    assert "Introduction (Spanish)" not in read(client.get(page)).text
    press(client, row, "add:scales::agreement_5")
    send(client, page, languages=["en", "es"])
    assert stored().scales["agreement_5"][0].label["es"] == "Muy en desacuerdo"


@pytest.mark.parametrize("slug", ["ict", "experience", "tlx", "simulator-sickness"])
def test_saving_every_page_of_what_was_written_elsewhere_changes_nothing(client, slug):
    row = store(shipped()[slug], NOW)
    definition = row.as_definition()
    items = [item.key for page in definition.pages for item in page.items]
    places = [("about",), *(("pages", page.key) for page in definition.pages)]
    places += [("questions", key) for key in items] + [("scales", key) for key in definition.scales]
    for place in places:
        assert send(client, at(row, *place)).status_code == 302, place
        assert (place, Questionnaire.objects.get().sha256) == (place, row.sha256)


def test_a_questionnaire_in_use_is_edited_as_a_new_version(client):
    row = freeze(store(defined([item("grid", "g", rows=rows("r"))]), NOW), NOW)
    for address in (at(row), at(row, "questions", "g")):
        page = read(client.get(address))
        assert "Edit as a new version" in page.text
        assert not [e for e in page.all("button") if "do" in e.attributes.get("name", "")]
        assert client.post(address, {"do": "save", "sha256": row.sha256}).status_code == 403
    answer = client.post(reverse("admin:surveys_questionnaire_new_version", args=[row.pk]))
    newer = Questionnaire.objects.get(version=2)
    assert answer.headers["Location"] == at(newer)
    assert problems_of(newer) == problems_of(row) == ()


def test_a_name_is_taken_once(client, row):
    address = reverse("admin:surveys_questionnaire_write")
    for name in ("the-doors", "sus"):
        sent = {"title": "Another", "languages": ["en"], "name": name}
        assert "There is already" in read(client.post(address, sent)).text
    assert faults(read(client.get(address))) == []
    assert "en" not in [e.text.strip() for e in read(client.get(address)).all("label")]


@pytest.mark.parametrize("place", [("pages",), ("nonsense",), ("questions", "q9"), ("about", "x")])
def test_pages_of_nothing_are_not_there(client, row, place):
    assert client.get(at(row, *place)).status_code == 404
    assert client.post(at(row, *place), {"do": "save", "kind": "nonsense"}).status_code == 404


@pytest.mark.parametrize(
    "do", ["", "add:questions:page_1:nonsense", "up:nonsense:q1", "burn:pages"]
)
def test_buttons_that_are_none_change_nothing(client, row, do):
    assert press(client, row, do).status_code == 302
    assert Questionnaire.objects.get().sha256 == row.sha256


@pytest.mark.parametrize(
    "do", ["add:nonsense", "add:text", "add:required", "add:key", "up:text:0", "remove:nonsense:0"]
)
def test_buttons_that_no_form_has_save_the_form_and_nothing_else(client, row, do):
    page = at(row, "questions", "q1")
    assert send(client, page, do, **texts("text", "Why?"), required="on").status_code == 302
    (question,) = stored().questions()
    assert question.text == {"en": "Why? (en)", "es": "Why? (es)"}
    assert (question.key, question.item.required) == ("q1", True)


def test_saving_a_part_may_lead_back_to_the_overview(client, row):
    answer = send(client, at(row, "questions", "q1"), "done", **texts("text", "Why?"))
    assert answer.headers["Location"] == f"{at(row)}#at-q1"
    assert stored().question("q1").text["en"] == "Why? (en)"


def test_permission_to_view_questionnaires_changes_none(client, row):
    user = person("reader", is_staff=True)
    user.user_permissions.set(Permission.objects.filter(codename="view_questionnaire"))
    client.force_login(user)
    page = at(row, "questions", "q1")
    assert client.get(page).status_code == 200
    assert client.post(page, {"do": "save", "sha256": row.sha256}).status_code == 403
    assert press(client, row, "remove:questions:q1").status_code == 403
    assert Questionnaire.objects.get().sha256 == row.sha256


def test_a_step_of_a_study_offers_what_is_complete_by_title_and_version(client, row):
    study = publishing.begin_empty("mine", "My study", ["en"], NOW)
    page = reverse("admin:experiments_study_part", args=[study.pk, "steps", 4])
    shown = read(client.get(page))
    assert "Write a questionnaire" in shown.text
    assert not [e for e in shown.all("option") if "The doors" in e.text]
    send(client, at(row, "questions", "q1"), **texts("text", "Why?"))
    options = {e.text: e.attributes["value"] for e in read(client.get(page)).all("option")}
    assert options["The doors, version 1"] == "the-doors:1"
    send(client, page, questionnaire="the-doors:1")
    study.refresh_from_db()
    step = study.as_definition().steps[4]
    assert (step.questionnaire, step.version) == ("the-doors", 1)


def test_a_list_of_another_page_is_not_changed_by_a_hand_made_button(client, row):
    before = stored()
    send(client, at(row, "about"), "add:pages")
    send(client, at(row, "pages", "page_1"), "add:items")
    assert stored() == before
