"""Who is asked what; the cases are shared with the page's module."""

import json

import pytest

from surveys.answers import read_answer
from surveys.conditions import Circumstances, shown_keys
from surveys.page_form import Reader, page_form_of
from tests.support.paths import GOLDEN
from tests.support.studies.questionnaires import NOW, defined, item

CASES = json.loads((GOLDEN / "survey_conditions.json").read_text())
NAMES = [{"value": name, "label": {"en": name}} for name in ("x", "y", "z")]


def question(key: str, condition: dict | None) -> dict:
    kinds = {"n": ("number", {}), "m": ("multiple", {"options": NAMES})}
    kind, more = kinds.get(key, ("single", {"options": NAMES, "prefer_not": True}))
    return item(kind, key, **more, **({"show_if": condition} if condition else {}))


@pytest.mark.parametrize("case", CASES, ids=lambda case: case["name"])
def test_conditions_on_answers(case):
    definition = defined([question(key, condition) for key, condition in case["questions"].items()])
    values = {
        key: read_answer(definition.question(key), case["said"], NOW).value
        for key in case["questions"]
    }
    assert shown_keys(definition, values, Circumstances()) == case["shown"]


@pytest.mark.parametrize(
    ("robot", "outcome", "shown"),
    [
        (["giraff"], "completed", ["r", "o", "both"]),
        (["g7", "giraff"], "", ["r"]),
        (["rhodon"], "completed", ["o"]),
        ([], "", []),
    ],
)
def test_conditions_on_robot_and_outcome(robot, outcome, shown):
    on_robot, on_outcome = {"robot": ["giraff"]}, {"outcome": ["completed", "timed_out"]}
    definition = defined(
        [
            item("text", "r", show_if=on_robot),
            item("text", "o", show_if=on_outcome),
            item("text", "both", show_if=on_robot | on_outcome),
        ]
    )
    assert (
        shown_keys(definition, {}, Circumstances(robot=frozenset(robot), outcome=outcome)) == shown
    )


def test_a_condition_on_an_order_asks_what_is_first():
    definition = defined(
        [item("ranking", "r"), item("text", "why", show_if={"item": "r", "is": ["a", "b"]})]
    )
    for order, shown in (("abc", True), ("bca", True), ("cab", False)):
        keys = shown_keys(definition, {"r": list(order)}, Circumstances())
        assert ("why" in keys) is shown
    reader = Reader("en", 0, NOW)
    _, why = page_form_of(definition, 0, reader, [0]).controls
    assert json.loads(why.show_if)["is"] == ["1.a", "1.b"]


def test_a_page_that_is_hidden_hides_its_questions():
    pages = [
        {"key": "one", "show_if": {"outcome": ["completed"]}, "items": [item("text", "a")]},
        {"key": "two", "items": [item("text", "b")]},
    ]
    assert shown_keys(defined(pages=pages), {}, Circumstances()) == ["b"]
