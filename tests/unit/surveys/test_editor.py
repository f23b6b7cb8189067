"""Changes in the editor: keys, places and problems."""

import copy

import msgspec
import pytest
from django.http import QueryDict
from django.utils.translation import override

from surveys.definition import Definition
from surveys.document_forms.problem_text import sentences
from surveys.editor.draft import EditorPlace, arrange, complete, earlier, new_entry, new_question
from surveys.editor.labels import READY, EditorForm, kind_name, ready_points
from surveys.editor.overview import problem_texts
from surveys.problems import problems
from surveys.questions import TYPES
from tests.support.studies.questionnaires import document, item, rows


def whole(*pages: list[dict], **more) -> dict:
    """A questionnaire as the editor has it."""
    return {"topics": [], **copy.deepcopy(document(*pages, **more))}


def keys(written: dict) -> list[list[str]]:
    return [[item["key"] for item in page["items"]] for page in written["pages"]]


def texts_by_place(written: dict) -> dict[str, list[str]]:
    found = problem_texts(problems(msgspec.convert(written, Definition)), written)
    return {place.key or place.section: texts for place, texts in found.items()}


@pytest.mark.parametrize("kind", TYPES)
def test_a_new_question_of_every_type_is_stored_though_its_words_are_missing(kind):
    written = whole([])
    question = new_question(kind, "agree", written)
    written["pages"][0]["items"].append(question)
    assert msgspec.convert(written, Definition).question("q1") or question["rows"]
    assert "Text (English) is missing." in texts_by_place(written)["q1"]
    assert EditorForm(TYPES[kind], question, languages=["en"], is_sent=True).refusals == {}
    assert str(kind_name(kind)) != kind


def test_a_type_without_a_plain_name_is_called_by_its_own(monkeypatch):
    monkeypatch.setattr(TYPES["single"], "plain_name", "")
    assert kind_name("single") == "Single"


def test_a_question_at_the_end_of_its_page_moves_on_to_the_next():
    written = whole([item("text", "a"), item("text", "b")], [item("text", "c")])
    arrange(written, "down", EditorPlace("questions", "b"))
    assert keys(written) == [["a"], ["b", "c"]]
    arrange(written, "up", EditorPlace("questions", "b"))
    arrange(written, "up", EditorPlace("questions", "b"))
    assert keys(written) == [["b", "a"], ["c"]]
    arrange(written, "up", EditorPlace("questions", "b"))
    arrange(written, "down", EditorPlace("pages", "page1"))
    assert keys(written) == [["c"], ["b", "a"]]


def test_a_copy_has_keys_of_its_own():
    written = whole([item("grid", "g", rows=rows("g_1", "g_2"))])
    arrange(written, "copy", EditorPlace("pages", "page1"))
    arrange(written, "copy", EditorPlace("questions", "g"))
    assert list(problems(msgspec.convert(written, Definition))) == []
    assert len(msgspec.convert(written, Definition).questions()) == 6


def test_conditions_and_topics_follow_a_question_that_is_renamed():
    asks = item("text", "b", show_if={"item": "a", "is": ["c"]})
    topic = {"key": "t", "text": {"en": "T"}, "items": ["a"]}
    written = whole([item("single", "a"), asks], topics=[topic])
    former = written["pages"][0]["items"][0]
    part = complete({**former, "key": "choice"}, former, written)
    written = EditorPlace("questions", "a").put(written, part)
    assert written["pages"][0]["items"][1]["show_if"]["item"] == "choice"
    assert written["topics"][0]["items"] == ["choice"]


def test_empty_and_taken_keys_are_replaced_and_options_named_by_label():
    written = whole([item("single", "a"), item("grid", "g", rows=rows("r"))])
    former = written["pages"][0]["items"][1]
    part = complete({**former, "key": "a", "rows": [{"key": "", "text": {}}]}, former, written)
    assert (part["key"], part["rows"][0]["key"]) == ("a_1", "a_1_1")
    single = new_question("single", "", written)
    for option, label in zip(single["options"], ("Sí, claro", "Sí, claro"), strict=True):
        option["label"] = {"es": label}
    values = [option["value"] for option in complete(single, single, written)["options"]]
    assert values == ["si_claro", "si_claro_1"]


def test_a_new_point_of_a_scale_has_the_next_value():
    cls = EditorPlace("scales").cls({})
    points = [{"value": 3}, {"value": -1}]
    assert new_entry(cls, "points", {"points": points}, whole([])) == {"value": 4}


@pytest.mark.parametrize("name", READY)
def test_scales_that_are_offered_are_whole_in_the_languages_of_the_site(name):
    written = whole([item("likert", "a")], scales={"agree": ready_points(name, ["en", "es"])})
    written |= {"languages": ["en", "es"]}
    assert not [
        text for text in problems(msgspec.convert(written, Definition)) if "scale" in str(text)
    ]
    assert ready_points(name, ["es", "fr"])[0]["label"] == {"es": "Muy en desacuerdo"}


def test_a_condition_may_ask_what_comes_before():
    written = whole([item("text", "a"), item("grid", "g", rows=rows("r")), item("text", "b")])
    definition = msgspec.convert(written, Definition)
    assert [one.key for one in earlier(definition, EditorPlace("questions", "b"))] == ["a", "r"]
    assert list(earlier(definition, EditorPlace("pages", "page1"))) == []


def test_problems_are_listed_where_they_are_corrected_without_keys():
    broken = [
        item("likert", "a", scale="none"),
        item("single", "b", options=[], show_if={"item": "z", "is": [1]}),
        item("multiple", "m", at_least=9),
        item("grid", "g", rows=[{"key": "r", "text": {}}]),
    ]
    ends = [{"value": 1}, {"value": 1}]
    written = whole(broken, [], scoring="sus", scales={"agree": ends})
    assert texts_by_place(written) == {
        "about": ["The SUS needs ten statements on a scale from 1 to 5."],
        "page2": ["This page has no questions. Add one."],
        "agree": ["The values must increase from point to point."],
        "a": ["Choose a scale."],
        "b": [
            "There are no options; add some.",
            "The condition refers to a question that does not come earlier.",
        ],
        "m": ["There are too few options for these limits."],
        "g": ["Statement 1 · Text (English) is missing."],
    }


def test_problems_are_in_the_language_of_the_page():
    written = whole([item("likert", "a", scale="none")], languages=["es"])
    found = list(problems(msgspec.convert(written, Definition)))
    with override("es"):
        assert "Elige una escala." in problem_texts(found, written)[EditorPlace("questions", "a")]
        assert "a: scale none: Elige una escala." in sentences(found)
        assert "a: scale none: Choose a scale." in map(str, found)


def test_leaving_a_language_takes_its_texts_out_of_pages_and_scales():
    both = {"en": "Yes", "es": "Sí"}
    points = [{"value": 1, "label": both}, {"value": 2, "label": both}]
    asks = {**item("likert", "a"), "text": both}
    written = whole([asks], scales={"agree": points}, languages=["en", "es"], title=both)
    about = EditorForm.read(
        Definition, QueryDict("languages=en&title.en=Yes&scoring=none"), only=("languages", "title")
    )
    kept = EditorPlace("about").put(written, about)
    assert list(problems(msgspec.convert(kept, Definition))) == []
