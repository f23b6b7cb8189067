"""The pages on which people answer, as a browser without JavaScript uses them, and as forgers try
them.
"""

import uuid

import pytest
from django.urls import reverse

from experiments.bots.answers import fill
from experiments.bots.page import HtmlPage
from experiments.bots.persona import Persona
from surveys.models import Response
from surveys.questionnaires import current, store
from surveys.questions import TYPES
from surveys.responses import Context, Respondent
from tests.support.browsers.html_page import faults, read
from tests.support.people import person
from tests.support.studies.questionnaires import NOW, defined, item, rows
from tests.support.studies.responses import begun

pytestmark = pytest.mark.django_db
EVERY_KIND = [
    item("likert", "l", prefer_not=True, not_applicable=True),
    item("grid", "g", rows=rows("g1", "g2"), hint={"en": "Each row"}),
    item("single", "s"),
    item("multiple", "m", not_applicable=True),
    item("number", "n", unit={"en": "years"}, whole=True),
    item("text", "t"),
    item("text", "long", lines=4),
    item("date", "d", latest="today"),
    item("slider", "x", prefer_not=True, hint={"en": "From low to high"}),
    item("ranking", "r", required=True),
]

ORDER = "l g1 g2 s m n t long d x r"
SENT = {
    "l": "~preferred_not",
    "g1": "-1",
    "g2": "1",
    "s": "b",
    "m": ["a", "c"],
    "n": "7",
    "t": 'a "quoted" <b>',
    "long": "y\nz",
    "d": "2020-01-01",
    "x": "65",
    "r": ["3.a", "1.b", "2.c"],
}


def test_a_whole_questionnaire_is_answered_page_by_page_and_leads_on(take):
    ada = take([item("single", "a")], [item("text", "b")])
    assert ada.get().url == ada.url(1)
    assert ada.send(1, "a", a="c").url == ada.url(2)
    assert ada.send(2, "b", b="well").url == "/about/"
    assert ada.stored() == {"a": "c", "b": "well"}
    assert ada.row().finished_at is not None


def test_a_question_about_another_robot_is_not_on_the_page(take):
    rhodon = item("text", "b", show_if={"robot": ["rhodon"]})
    ada = take([item("text", "a"), rhodon, item("text", "c", show_if={"robot": ["giraff"]})])
    shown = [e.attributes.get("data-question") for e in read(ada.get(1)).all("fieldset")]
    assert list(filter(None, shown)) == ["a", "c"]


@pytest.mark.parametrize("kind", TYPES)
def test_a_bot_answers_a_question_of_every_type_from_its_page_alone(take, kind):
    more = {"rows": rows("q1", "q2")} if kind == "grid" else {}
    ada = take([item(kind, "q", required=True, **more)])
    form = HtmlPage(ada.get(1).content.decode()).form("survey")
    sent = [*form.hidden, *fill(form, Persona(1, 3), {}, NOW)]
    fields = {name: [value for other, value in sent if other == name] for name, _value in sent}
    assert ada.client.post(ada.url(1), fields).url == "/about/"
    assert ada.row().finished_at is not None


def test_every_kind_is_drawn_for_those_who_cannot_see_and_sent_without_javascript(take):
    ada = take(EVERY_KIND)
    page = read(ada.get(1))
    assert faults(page) == []
    groups = [e for e in page.all("fieldset") if "data-question" in e.attributes]
    assert [e.attributes["data-question"] for e in groups] == ORDER.split()
    assert len(page.all("legend")) == len(groups)
    assert ada.send(1, ORDER, **SENT).url == "/about/"
    read_as = {"l": "(preferred_not)", "g1": -1, "g2": 1, "n": 7, "x": 65, "r": ["b", "c", "a"]}
    assert ada.stored() == SENT | read_as


def test_every_row_of_a_matrix_repeats_the_words_of_its_columns(take):
    page = read(take([item("grid", "g", rows=rows("g1", "g2"))]).get(1))
    for row in (e for e in page.all("fieldset") if e.attributes.get("data-question")):
        assert all(word in row.text for word in ("No", "Maybe", "Yes"))


def test_answers_are_shown_again_after_every_return_to_the_page(take):
    ada = take(EVERY_KIND, [item("text", "next")])
    ada.send(1, ORDER, **SENT | {"m": [], "m~": "not_applicable"})
    page = read(ada.get(1))
    inputs = [e.attributes for e in page.all("input")]
    chosen = {(one["name"], one["value"]) for one in inputs if "checked" in one}
    assert chosen == {
        *(("l", "~preferred_not"), ("g1", "-1"), ("g2", "1"), ("s", "b"), ("m~", "not_applicable"))
    }
    written = {one["name"]: one["value"] for one in inputs if one.get("name") in set("ntdx")}
    assert written == {name: SENT[name] for name in "ntdx"}
    assert page.all("textarea")[0].text == "y\nz"
    assert selected(page) == ["1.b", "2.c", "3.a"]


def selected(page) -> list[str]:
    return [e.attributes["value"] for e in page.all("option") if "selected" in e.attributes]


def test_an_incomplete_ranking_is_shown_again_as_it_was_sent(take):
    ada = take([item("ranking", "r", prefer_not=True)])
    for given, message in ((["2.a", "2.b"], "a different place"), (["3.a", "2.c"], "every option")):
        answer = ada.send(1, "r", r=given)
        page = read(answer)
        assert answer.status_code == 422
        assert faults(page) == []
        assert message in page.text
        assert set(selected(page)) == set(given)
        assert all(e.attributes["aria-invalid"] == "true" for e in page.all("select"))
    assert ada.stored() == {}
    assert ada.send(1, "r", r=["", ""], **{"r~": "preferred_not"}).url == "/about/"
    assert ada.stored() == {"r": "(preferred_not)"}


def test_a_respondent_resumes_on_another_device(take, client):
    ada = take([item("text", "a")], [item("text", "b")], [item("text", "c")])
    ada.send(1, "a", a="one")
    client.logout()
    client.force_login(ada.response.user)
    assert ada.get().url == ada.url(2)
    assert ada.get(3).url == ada.url(2)


def test_going_back_saves_what_is_there_and_demands_nothing(take):
    ada = take([item("text", "a")], [item("text", "b", required=True), item("text", "c")])
    ada.send(1, "a", a="one")
    assert ada.send(2, "b c", b="", c="kept", go="back").url == ada.url(1)
    assert ada.stored()["c"] == "kept"
    assert ada.get().url == ada.url(2)


def test_a_page_with_gaps_is_shown_again_with_answers_and_missing_ones(take):
    required = item("single", "a", required=True)
    ada = take([required, item("number", "n", maximum=5), item("text", "t")])
    answer = ada.send(1, "a n t", n="9", t="kept")
    page = read(answer)
    assert answer.status_code == 422
    assert faults(page) == []
    alert = next(e for e in page.elements if e.attributes.get("role") == "alert")
    links = {e.attributes["href"] for e in page.all("a")}
    assert {link for link in links if link.startswith("#q-")} == {"#q-a", "#q-n"}
    assert "Text of a" in alert.text
    assert "Enter a number of at most 5." in page.text
    (number,) = (e for e in page.all("input") if e.attributes.get("name") == "n")
    assert number.attributes["value"] == "9"
    assert ada.stored() == {"a": "(skipped)", "t": "kept"}


def test_without_javascript_new_questions_are_shown_before_the_next_page(take):
    ada = take([item("single", "a"), item("text", "why", show_if={"item": "a", "is": ["c"]})])

    def why(page):
        groups = [e.attributes for e in page.all("fieldset")]
        return next(one for one in groups if one.get("data-question") == "why").keys()

    assert {"hidden", "disabled"} <= why(read(ada.get(1)))
    answer = ada.send(1, "a", a="c")
    assert answer.status_code == 422
    assert "more questions" in read(answer).text
    assert "hidden" not in why(read(answer))
    assert ada.send(1, "a why", a="c", why="because").url == "/about/"


def test_a_double_submit_changes_nothing(take):
    ada = take([item("text", "a")], [item("text", "b")])
    for _ in range(2):
        assert ada.send(1, "a", a="one").url == ada.url(2)
    ada.send(2, "b", b="two")
    finished = ada.row().finished_at
    assert ada.send(2, "b", b="three").url == "/about/"
    assert ada.stored() == {"a": "one", "b": "two"}
    assert ada.row().finished_at == finished


def test_single_answers_are_saved_as_they_are_given(take):
    ada = take([item("single", "a", required=True), item("multiple", "m")])
    first = ada.save("a", "c", seconds='{"a": 1.5}', writer="w", writing="1")
    assert first.json() == ada.save("m", ["a", "b"]).json() == {"saved": True}
    assert ada.stored() == {"a": "c", "m": ["a", "b"]}
    assert ada.row().answers.get(item="a").writer == "w"
    assert ada.save("a").status_code == 200
    assert ada.stored()["a"] == "(skipped)"


@pytest.mark.parametrize(
    ("fields", "status"),
    [
        ({"item": "a", "a": "z"}, 422),
        ({"item": "a", "a": "~preferred_not"}, 422),
        ({"item": "n", "n": "1e400"}, 422),
        ({"item": "hidden", "hidden": "x"}, 400),
        ({"item": "later", "later": "x"}, 400),
        ({"item": "no-such"}, 400),
        ({}, 400),
        ({"item": "a\x00"}, 400),
        ({"item": "x" * 5000}, 400),
    ],
)
def test_a_forged_answer_is_refused_with_a_reason_and_stores_nothing(take, fields, status):
    hidden = item("text", "hidden", show_if={"robot": ["rhodon"]})
    ada = take([item("single", "a"), item("number", "n"), hidden], [item("text", "later")])
    answer = ada.client.post(reverse("survey_answer", args=[ada.response.pk]), fields)
    assert answer.status_code == status
    assert answer.json()["saved"] is False
    assert answer.json()["error"]
    assert ada.stored() == {}


@pytest.mark.parametrize(
    "seconds",
    ["nonsense", "[]", '{"a": "x"}', '{"a": null}', '{"a": true}', '{"a": Infinity}', "[" * 20_000],
)
def test_malformed_times_from_a_page_lose_no_answer(take, seconds):
    ada = take([item("single", "a")])
    answer = ada.save("a", "c", seconds=seconds, writing="-9" * 40, writer="w" * 500)
    assert answer.status_code == 200
    assert ada.stored() == {"a": "c"}


def test_a_page_of_questions_that_are_not_asked_is_refused_and_leads_back(take):
    ada = take([item("text", "a")], [item("text", "b")])
    answer = ada.send(1, "a b", a="x", b="y")
    assert answer.status_code == 400
    assert faults(read(answer)) == []
    assert ada.stored() == {}
    assert ada.send(2, "b", b="y").url == ada.url(1)
    assert ada.send(9, "b", b="y").url == ada.url(1)


def test_the_response_of_another_user_is_not_found(take, client):
    ada = take([item("text", "a")])
    client.force_login(person("eve"))
    assert ada.get().status_code == 404
    assert ada.get(1).status_code == 404
    assert ada.send(1, "a", a="x").status_code == 404
    assert ada.save("a", "x").status_code == 404
    assert client.get(reverse("survey_done", args=[ada.response.pk])).status_code == 404
    assert client.get(reverse("survey", args=[uuid.uuid4()])).status_code == 404
    assert ada.stored() == {}


def test_a_stranger_is_asked_to_log_in_and_learns_nothing(take, client):
    ada = take([item("text", "a")])
    client.logout()
    for address in (ada.url(1), reverse("survey", args=[uuid.uuid4()])):
        assert client.get(address).url == f"{reverse('account_login')}?next={address}"
    assert ada.save("a", "x").status_code == 403
    assert ada.save("a", "x").json()["error"].startswith("You are logged out")


def test_an_anonymous_response_is_on_no_page(client):
    row = begun(store(defined([item("text", "a")]), NOW))
    address = reverse("survey_page", args=[row.pk, 1])
    assert client.get(address).url == f"{reverse('account_login')}?next={address}"
    client.force_login(person("anna"))
    assert client.get(address).status_code == 404


def test_the_thanks_come_only_after_the_answers(take):
    ada = take([item("text", "a")], context=Context(key="c"))
    thanks = reverse("survey_done", args=[ada.response.pk])
    assert ada.client.get(thanks).url == reverse("survey", args=[ada.response.pk])
    assert ada.send(1, "a", a="x").url == thanks
    thanked = read(ada.client.get(thanks))
    assert "Thank you" in thanked.text
    assert faults(thanked) == []


def test_answers_need_the_token_of_a_page_of_ours(take):
    from django.test import Client

    ada = take([item("text", "a")])
    careful = Client(enforce_csrf_checks=True)
    careful.force_login(ada.response.user)
    for address in (ada.url(1), reverse("survey_answer", args=[ada.response.pk])):
        answer = {"shown": "a", "item": "a", "a": "x"}
        assert careful.post(address, answer).status_code == 403


def test_a_page_speaks_the_respondents_language_and_stores_which_it_was(client):
    user = person()
    client.force_login(user)
    row = begun(current("sus", NOW), Respondent(user=user), language="es")
    address, answer = (
        reverse("survey_page", args=[row.pk, 1]),
        reverse("survey_answer", args=[row.pk]),
    )
    page = read(client.get(address, headers={"accept-language": "es"}))
    assert "El uso del sistema" in page.text
    assert faults(page) == []
    for key, language in (("sus1", "es"), ("sus2", "fr")):
        client.post(answer, {"item": key, key: "4"}, headers={"accept-language": language})
    saved = {a.item: a for a in Response.objects.get().answers.all()}
    assert (saved["sus1"].language, saved["sus2"].language) == ("es", "en")
    question = row.questionnaire.as_definition().question("sus1")
    assert saved["sus1"].text_version == question.fingerprint("es") != question.fingerprint("en")


def test_a_shuffled_page_keeps_its_order_for_a_respondent(take):
    names = "abcdefgh"
    pages = [{"key": "p", "order": "shuffled", "items": [item("text", name) for name in names]}]
    ada = take(pages=pages, seed=11)

    def order():
        groups = [e.attributes.get("data-question") for e in read(ada.get(1)).all("fieldset")]
        return list(filter(None, groups))

    first = order()
    assert first != list(names)
    assert order() == first
    ada.send(1, " ".join(names), **dict.fromkeys(names, "x"))
    answers = ada.row().answers.order_by("position")
    assert [(one.position, one.item) for one in answers] == list(enumerate(first, start=1))
