"""Answers that questions allow or refuse."""

import datetime

import pytest
from django.utils import translation

from surveys.answers import AnswerValue, Missing, check_complete, read_answer, response_statuses
from surveys.conditions import Circumstances
from surveys.item import RefusedError
from tests.support.studies.questionnaires import NOW, OPTIONS, defined, item

ALONE = [*OPTIONS[:2], {"value": "none", "label": {"en": "None"}, "alone": True}]


def answer_to(
    kind: str, *values: str, reason: str = "", now: datetime.datetime = NOW, **more
) -> AnswerValue:
    question = defined([item(kind, "q", **more)]).question("q")
    return read_answer(question, {"q": values, **({"q~": [reason]} if reason else {})}, now)


@pytest.mark.parametrize(
    ("kind", "more", "values", "stored"),
    [
        ("likert", {}, ["-1"], -1),
        ("single", {}, ["b"], "b"),
        ("multiple", {}, ["c", "a", "c"], ["a", "c"]),
        ("multiple", {"options": ALONE}, ["none"], ["none"]),
        ("multiple", {"options": ALONE, "at_least": 2}, ["none"], ["none"]),
        ("ranking", {}, ["2.a", "3.b", "1.c"], ["c", "a", "b"]),
        ("number", {"whole": True}, ["42"], 42),
        ("number", {}, [" 2.5 "], 2.5),
        ("number", {"minimum": -3}, ["-3"], -3.0),
        ("number", {"maximum": "this_year", "whole": True}, ["2026"], 2026),
        ("text", {}, ["  hello\r\nyou "], "hello\nyou"),
        ("text", {}, ["fine\r=1+1"], "fine\n=1+1"),
        ("text", {}, ["~preferred_not"], "~preferred_not"),
        ("text", {}, ["a\x00b"], "ab"),
        ("date", {}, ["2024-02-29"], "2024-02-29"),
        ("slider", {}, ["0"], 0),
        ("slider", {"step": 5}, ["100"], 100),
    ],
)
def test_an_answer_is_stored_as_a_value_of_its_kind(kind, more, values, stored):
    given = answer_to(kind, *values, **more)
    assert given == AnswerValue(value=stored)
    assert type(given.value) is type(stored)


def test_a_comma_is_a_decimal_mark_in_spanish_and_refused_in_english():
    with translation.override("es"):
        assert answer_to("number", "2,5") == AnswerValue(value=2.5)
    for text in ("2,5", "1,000"):
        with translation.override("en"), pytest.raises(RefusedError, match="no comma"):
            answer_to("number", text)


@pytest.mark.parametrize(
    ("kind", "more", "values", "message"),
    [
        ("likert", {}, ["2"], "one of the options offered"),
        ("likert", {}, ["1", "0"], "one answer"),
        ("likert", {}, ["1.0"], "one of the options offered"),
        ("single", {}, ["z"], "one of the options offered"),
        ("multiple", {}, ["a", "z"], "one of the options offered"),
        ("multiple", {"at_least": 2}, ["a"], "at least 2"),
        ("multiple", {"at_most": 1}, ["a", "b"], "at most 1"),
        ("multiple", {"options": ALONE}, ["a", "none"], "excludes"),
        ("ranking", {}, ["1.a", "2.b", "3.z"], "one of the options offered"),
        ("ranking", {}, ["1.a", "2.b", "4.c"], "one of the options offered"),
        ("ranking", {}, ["1.a", "2.b", "03.c"], "one of the options offered"),
        ("ranking", {}, ["a", "b", "c"], "one of the options offered"),
        ("ranking", {}, ["1.a", "2.b"], "every option"),
        ("ranking", {}, ["1.a", "1.b", "3.c"], "different place"),
        ("ranking", {}, ["1.a", "2.a", "3.c"], "different place"),
        ("number", {"whole": True}, ["4.5"], "whole"),
        ("number", {}, ["four"], "a number"),
        ("number", {}, ["nan"], "a number"),
        ("number", {}, ["1e999"], "a number"),
        ("number", {}, ["1_0"], "a number"),
        ("number", {}, ["9" * 5000], "a number"),
        ("number", {"minimum": 3}, ["2"], "at least 3"),
        ("number", {"maximum": 2.5}, ["2.6"], "at most 2.5"),
        ("number", {"maximum": "this_year"}, ["2027"], "at most 2026"),
        ("text", {"max_length": 3}, ["abcd"], "at most 3"),
        ("date", {}, ["2023-02-29"], "year-month-day"),
        ("date", {}, ["tomorrow"], "year-month-day"),
        ("date", {"earliest": "2024-01-01"}, ["2023-12-31"], "earliest"),
        ("date", {"latest": "today"}, ["2026-03-06"], "latest"),
        ("slider", {}, ["101"], "from 0 to 100"),
        ("slider", {}, ["-1"], "from 0 to 100"),
        ("slider", {"step": 5}, ["7"], "steps of 5"),
        ("slider", {}, ["7.5"], "from 0 to 100"),
    ],
)
def test_an_answer_out_of_bounds_is_refused_with_the_bound(kind, more, values, message):
    with pytest.raises(RefusedError, match=message):
        answer_to(kind, *values, **more)


def test_today_is_any_day_that_it_is_somewhere_on_earth():
    night = NOW.replace(hour=23)
    assert answer_to("date", "2026-03-05", latest="today", now=night).value == "2026-03-05"
    morning = NOW.replace(hour=1)
    assert answer_to("date", "2026-03-03", earliest="today", now=morning).value == "2026-03-03"


@pytest.mark.parametrize(
    "kind", ["likert", "single", "multiple", "ranking", "number", "text", "date", "slider"]
)
def test_saying_nothing_is_skipped_and_refused_only_where_an_answer_is_required(kind):
    for values in ([], [""], ["  "]):
        assert answer_to(kind, *values) == AnswerValue(missing=Missing.SKIPPED)
    required = defined([item(kind, "q", required=True)]).question("q")
    with pytest.raises(RefusedError, match="Answer this question"):
        check_complete(required, AnswerValue(missing=Missing.SKIPPED))
    check_complete(required, AnswerValue(missing=Missing.PREFERRED_NOT))
    check_complete(defined([item(kind, "q")]).question("q"), AnswerValue(missing=Missing.SKIPPED))


@pytest.mark.parametrize("kind", ["likert", "single"])
def test_a_reason_is_one_of_the_choices_of_a_single_choice(kind):
    assert answer_to(kind, "~preferred_not", prefer_not=True) == AnswerValue(
        missing=Missing.PREFERRED_NOT
    )
    with pytest.raises(RefusedError):
        answer_to(kind, "~preferred_not", not_applicable=True)


@pytest.mark.parametrize(
    ("kind", "value"),
    [
        ("multiple", "a"),
        ("ranking", "1.a"),
        ("number", "3"),
        ("text", "x"),
        ("date", "2020-01-01"),
        ("slider", "5"),
    ],
)
def test_elsewhere_a_reason_comes_beside_the_answer_and_not_with_it(kind, value):
    assert answer_to(kind, reason="not_applicable", not_applicable=True) == AnswerValue(
        missing=Missing.NOT_APPLICABLE
    )
    with pytest.raises(RefusedError, match="Give either an answer or one reason"):
        answer_to(kind, value, reason="not_applicable", not_applicable=True)
    for forged in ("preferred_not", "not_reached", "skipped", "nonsense"):
        with pytest.raises(RefusedError, match="one of the options offered"):
            answer_to(kind, reason=forged, not_applicable=True)


def test_missing_answers_have_one_of_five_reasons():
    definition = defined(
        [
            item("single", "left"),
            item("single", "declined"),
            item("single", "hidden", show_if={"robot": ["giraff"]}),
            item("single", "said"),
            item("single", "apart", not_applicable=True),
        ],
        [item("single", "here"), item("single", "now")],
        [item("single", "never")],
    )
    stored = {
        "declined": AnswerValue(missing=Missing.PREFERRED_NOT),
        "apart": AnswerValue(missing=Missing.NOT_APPLICABLE),
        "said": AnswerValue(value="a"),
        "hidden": AnswerValue(value="b"),
        "now": AnswerValue(value="c"),
    }
    found = response_statuses(
        definition, stored, Circumstances(robot=frozenset({"rhodon"})), reached=1
    )
    assert {key: given.missing for key, given in found.items()} == {
        "left": "skipped",
        "declined": "preferred_not",
        "hidden": "not_asked",
        "apart": "not_applicable",
        "said": None,
        "here": "not_reached",
        "now": None,
        "never": "not_reached",
    }
    assert found["hidden"].value is None
