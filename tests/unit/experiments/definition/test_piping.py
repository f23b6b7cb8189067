import msgspec
import pytest

from experiments.definition.recruitment.piping import MOST_CHARACTERS, filled, piping_problems
from experiments.definition.schema import StudyDefinition
from experiments.definition.shipped import shipped

ANSWERS = {("ict", "age"): "34", ("ict", "name"): "Ada"}


def fill(text: str, answers=ANSWERS) -> str:
    return filled(text, lambda name, item: answers.get((name, item), ""))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("You are {{ict.age}}.", "You are 34."),
        ("Hello {{ ict.name }}!", "Hello Ada!"),
        ("Hello {{ict.nickname|you}}!", "Hello you!"),
        ("Hello {{ict.nickname}}!", "Hello –!"),
        ("A {single} brace, {{no}} point", "A {single} brace, {{no}} point"),
    ],
)
def test_placeholders_are_filled_in_with_answers(text, expected):
    assert fill(text) == expected


@pytest.mark.parametrize(
    ("answer", "expected"),
    [
        ("a\nb\x00c\u202ed", "a b c d"),
        ("{{ict.age}}", "{{ict.age}}"),
        ("x" * 300, "x" * (MOST_CHARACTERS - 1) + "…"),
        ("\u200b\n", "–"),
        ("<b>=1+1</b>", "<b>=1+1</b>"),
    ],
)
def test_an_answer_is_one_plain_line_and_never_filled_in_again(answer, expected):
    assert fill("{{q.i}}", {("q", "i"): answer}) == expected


def test_a_text_may_only_refer_to_a_questionnaire_that_was_asked_before():
    whole = msgspec.to_builtins(shipped()["exploration"])
    keys = [step["key"] for step in whole["steps"]]
    whole["steps"][keys.index("instructions")]["leaves"][0]["text"]["en"] = "{{ict.age}}"
    study = msgspec.convert(whole, StudyDefinition)
    assert list(piping_problems(study.steps)) == []
    whole["steps"][keys.index("instructions")]["leaves"][0]["text"]["en"] = "{{experience.q1}}"
    found = list(piping_problems(msgspec.convert(whole, StudyDefinition).steps))
    assert len(found) == 1
    assert "experience.q1" in found[0].sentence(str)
