"""The problems of definitions that cannot be imported."""

import json
import re

import msgspec
import pytest

from surveys.definition import Definition, Page, digest, to_json
from surveys.documents import BadDefinitionError
from surveys.item import ItemCondition, ScalePoint
from surveys.problems import MAX_BYTES, parse
from surveys.questions import TYPES
from tests.support.paths import ROOT
from tests.support.studies.questionnaires import (
    AGREE,
    OPTIONS,
    as_bytes,
    defined,
    document,
    item,
    rows,
)


def refused(content: bytes | dict) -> str:
    with pytest.raises(BadDefinitionError) as caught:
        parse(content if isinstance(content, bytes) else as_bytes(content))
    return "\n".join(map(str, caught.value.problems))


def likert(**more) -> dict:
    return item("likert", "q1", **more)


def test_every_kind_of_item_is_read_and_written_again_without_loss():
    kinds = [
        item("likert", "l", required=True, prefer_not=True, not_applicable=True),
        item("grid", "g", rows=rows("g1", "g2"), order="shuffled"),
        item("single", "s", order="shuffled"),
        item("multiple", "m", at_least=1, at_most=3),
        item("ranking", "r", order="shuffled"),
        item("number", "n", minimum=1900, maximum="this_year", whole=True),
        item("text", "t", lines=4, max_length=200),
        item("date", "d", earliest="2020-01-01", latest="today"),
        item("slider", "x", step=5),
    ]
    condition = {"robot": ["giraff"], "outcome": ["completed"], "item": "l", "is": [1]}
    definition = defined(kinds, [item("text", "why", show_if=condition)])
    again = parse(to_json(definition))
    assert again == definition
    assert digest(again) == digest(definition)
    keys = [question.key for question in definition.questions()]
    assert keys == ["l", "g1", "g2", "s", "m", "r", "n", "t", "d", "x", "why"]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"{", "not valid JSON"),
        (b"\xff\xfe", "not valid JSON"),
        (b"[]", "Expected `object`"),
        (b"{}", "missing required field `format`"),
        (b" " * (MAX_BYTES + 1), "larger than 512 kB"),
        (b"[" * 100_000, "Expected `object`"),
    ],
)
def test_files_that_are_no_definition_have_a_message_of_their_own(content, message):
    assert message in refused(content)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": 2}, "$.format"),
        ({"version": 0}, "$.version"),
        ({"slug": "No Good"}, "$.slug"),
        ({"colour": "red"}, "unknown field `colour`"),
        ({"pages": []}, "There is no page; add at least one."),
        ({"languages": []}, "There is no language; add at least one."),
        ({"languages": ["en", "en"]}, "Language “en” appears 2 times"),
        ({"languages": ["en", "es"]}, "q1.text has no text in es"),
        ({"title": {"en": "T", "fr": "T"}}, "fr, which is not among"),
        ({"title": {"en": "  "}}, "title has no text in en"),
        ({"title": {"en": "a\x00b"}}, "null character"),
        ({"source": "\x00"}, "null character"),
        ({"intro": {"en": "x" * 5000}}, "longer than 4000"),
        ({"scales": {}}, "q1: scale agree: Choose a scale."),
        (
            {"scales": {"agree": AGREE[:1]}},
            "scale agree: A scale needs 2 to 11 points; this one has 1.",
        ),
        ({"scales": {"agree": AGREE[::-1]}}, "must increase"),
        (
            {"scales": {"agree": [AGREE[0], {"value": 3}]}},
            "scale agree: Label the first and the last point.",
        ),
        ({"scales": {"a.b": AGREE}}, "$.scales"),
        ({"scoring": "magic"}, "$.scoring"),
        ({"scoring": "sus"}, "ten statements"),
        ({"scoring": "tlx_raw"}, "six sliders"),
        ({"scoring": "topics"}, "A mean of each topic needs topics."),
        (
            {"topics": [{"key": "t", "text": {"en": "T"}, "items": ["zz"]}]},
            "topic t: zz: A topic has a question that it can't use.",
        ),
    ],
)
def test_a_problem_of_the_questionnaire_has_its_place(change, message):
    assert message in refused(document([likert()], **change))


@pytest.mark.parametrize(
    ("items", "message"),
    [
        ([], "page page1: This page has no questions."),
        (
            [item("grid", f"g{n}", rows=rows(*(f"r{n}_{m}" for m in range(7)))) for n in range(43)],
            "There are 301 questions; at most 300 are allowed.",
        ),
        ([likert(), likert()], "Name in the data “q1” appears 2 times"),
        (
            [{**likert(), "kind": "essay"}],
            "$.pages[0].items[0]: there is no question type “essay”; choose one of ",
        ),
        ([likert(requird=True)], "unknown field `requird`"),
        ([item("likert", "Q 1")], "items[0].key"),
        ([item("grid", "g", rows=[])], "g: There are no statements; add some."),
        ([item("grid", "g", rows=rows("g"))], "Name in the data “g” appears 2 times"),
        ([item("grid", "g", rows=[{"key": "r", "text": {"en": ""}}])], "r.text has no text"),
        ([item("single", "s", options=[])], "s: There are no options; add some."),
        ([item("single", "s", options=OPTIONS[:1] * 2)], "Option “a” appears 2 times"),
        (
            [item("multiple", "m", at_least=3, at_most=2)],
            "m: at_least, at_most: There are too few options",
        ),
        ([item("multiple", "m", at_most=9)], "m: at_least, at_most: There are too few options"),
        ([item("ranking", "r", options=[])], "r: There are no options"),
        (
            [item("ranking", "r", options=OPTIONS[:1])],
            "r: A ranking needs 2 to 20 options; this one has 1.",
        ),
        ([item("ranking", "r", options=OPTIONS[:1] * 2)], "Option “a” appears 2 times"),
        (
            [item("ranking", "r", options=[*OPTIONS, OPTIONS[0] | {"alone": True}])],
            "r: alone: An option of a ranking can't exclude",
        ),
        ([item("number", "n", minimum=5, maximum=1)], "minimum is greater"),
        ([item("slider", "x", minimum=9, maximum=1)], "multiple of the step"),
        ([item("slider", "x", step=7)], "multiple of the step"),
        ([item("slider", "x", maximum=10**9)], "$.pages"),
        ([item("text", "t", max_length=0)], "$.pages"),
        (
            [item("date", "d", earliest="2020-02-31")],
            "d: 2020-02-31: Write a day as year-month-day",
        ),
        ([item("date", "d", earliest="2021-01-01", latest="2020-01-01")], "after the latest day"),
    ],
)
def test_a_problem_of_an_item_has_its_key(items, message):
    assert message in refused(document(items))


@pytest.mark.parametrize(
    ("condition", "message"),
    [
        ({}, "own: show_if: Choose when it is shown"),
        ({"item": "q1"}, "own: show_if: Choose both an earlier question"),
        ({"is": [1]}, "own: show_if: Choose both an earlier question"),
        ({"item": "later", "is": ["a"]}, "own: show_if: later: The condition refers to a question"),
        ({"item": "own", "is": ["x"]}, "does not come earlier"),
        ({"item": "q1", "is": [7]}, "own: show_if: is 7: The condition expects an answer"),
        ({"item": "s", "is": ["z"]}, "show_if: is z"),
        ({"item": "s", "at_least": 2}, "Only the answer to a number question"),
        ({"item": "r", "is": ["z"]}, "show_if: is z"),
        ({"item": "r", "at_most": 1}, "Only the answer to a number question"),
    ],
)
def test_a_condition_that_cannot_be_decided_is_refused(condition, message):
    items = [
        likert(),
        item("single", "s"),
        item("ranking", "r"),
        item("text", "own", show_if=condition),
        item("single", "later"),
    ]
    assert message in refused(document(items))


def test_on_a_shuffled_page_no_question_is_earlier_than_another():
    why = item("text", "why", show_if={"item": "q1", "is": [1]})
    shuffled = {"key": "p", "order": "shuffled", "items": [likert(), why]}
    assert "does not come earlier" in refused({**document(), "pages": [shuffled]})
    fine = [shuffled | {"items": [likert()]}, {"key": "p2", "items": [why]}]
    assert parse(as_bytes({**document(), "pages": fine}))


def test_all_problems_are_listed_at_once():
    wrong = [likert(scale="none"), item("single", "s", options=[])]
    messages = refused(document(wrong, title={"en": ""}))
    assert len(messages.splitlines()) == 3


def test_the_text_version_changes_with_any_word_of_its_language_and_with_no_other():
    def version(language: str, **more) -> str:
        both = {"en": "One", "es": "Uno"}
        options = [{"value": "a", "label": {"en": "A", "es": "A"}}]
        written = document([item("single", "s", **{"text": both, "options": options} | more)])
        written |= {"languages": ["en", "es"], "title": both, "scales": {}}
        return parse(json.dumps(written).encode()).question("s").fingerprint(language)

    changed = {"text": {"en": "One", "es": "Una"}}
    assert version("en") == version("en", **changed)
    assert version("es") != version("es", **changed)
    assert version("en") != version("en", options=[{"value": "a", "label": {"en": "B", "es": "A"}}])


def test_the_reference_shows_a_file_that_is_right_and_names_every_field():
    reference = (ROOT / "docs" / "reference" / "questionnaires.md").read_text()
    example = re.search(r"```json\n(.*?)```", reference, re.DOTALL)[1]
    assert [question.key for question in parse(example.encode()).questions()] == ["through", "why"]
    named = set(re.findall(r"`(\w+)`", reference))
    assert set(TYPES) <= named
    for part in (Definition, Page, ScalePoint, ItemCondition, *TYPES.values()):
        assert {field.encode_name for field in msgspec.structs.fields(part)} <= named, part


UNEVEN = [{"value": value, "label": {"en": str(value)}} for value in (1, 2, 4)]
TOPIC = {"key": "t", "text": {"en": "T"}, "items": ["q1", "s"]}


@pytest.mark.parametrize(
    ("items", "change", "message"),
    [
        ([likert(reverse=True)], {}, "q1: reverse: It is reversed, but no score uses it."),
        (
            [likert(reverse=True)],
            {"scoring": "likert", "scales": {"agree": UNEVEN}},
            "q1: reverse: A scale that isn't symmetric can't be reversed.",
        ),
        (
            [likert(), item("slider", "s")],
            {"scoring": "topics", "topics": [TOPIC]},
            "topic t: The questions of a topic need the same scale.",
        ),
        ([item("number", "n", reverse=True)], {}, "unknown field `reverse`"),
        ([item("grid", "g", rows=rows("r"), reverse=True)], {}, "unknown field `reverse`"),
    ],
)
def test_an_item_is_reversed_only_where_a_score_can_count_it_so(items, change, message):
    assert message in refused(document(items, **change))


def test_sus_reverses_its_even_statements_itself():
    whole = json.loads((ROOT / "surveys/definitions/sus.json").read_text())
    whole["pages"][0]["items"][1]["reverse"] = True
    assert "sus2: reverse: The SUS reverses its statements itself." in refused(whole)


def test_a_document_of_many_problems_lists_the_first_hundred():
    wrong = document([item("text", "t")])
    wrong["title"] |= {f"k{number}": "x" for number in range(5_000)}
    messages = refused(wrong).splitlines()
    assert len(messages) == 101
    assert messages[-1] == "Only the first 100 problems are listed."
