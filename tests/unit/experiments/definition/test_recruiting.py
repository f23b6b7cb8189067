import pytest

from experiments.definition.recruitment.recruiting import (
    AnswerQuota,
    AnswerRule,
    EndingCodes,
    Recruiting,
    admits,
    names_answer,
    recruiting_problems,
    screening_problems,
)


def rule(**fields) -> AnswerRule:
    return AnswerRule(questionnaire="q", item="i", **fields)


@pytest.mark.parametrize(
    ("fields", "value", "expected"),
    [
        ({"answers": ("yes",)}, "yes", True),
        ({"answers": ("yes",)}, "no", False),
        ({"answers": ("yes",)}, None, False),
        ({"answers": ("3",)}, 3, True),
        ({"answers": ("3",)}, 3.0, True),
        ({"answers": ("a", "b")}, ["b", "c"], True),
        ({"answers": ("a",)}, ["b"], False),
        ({"at_least": 18.0}, 18, True),
        ({"at_least": 18.0}, 17.9, False),
        ({"at_most": 65.0}, 66, False),
        ({"at_least": 18.0}, "18", False),
        ({"at_least": 0.0}, True, False),
        ({"answers": ("5",), "at_least": 6.0}, 5, False),
    ],
)
def test_an_answer_meets_a_rule_by_name_and_bounds(fields, value, expected):
    assert admits(rule(**fields), value) is expected


def test_no_choice_of_several_is_no_answer():
    assert not names_answer(["a"], [])


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"site": "other", "return_address": "https://a.example/"}, "parameter of the link"),
        ({"site": "sona"}, "return address that the recruitment site shows"),
        ({"return_address": "http://a.example/?{code}"}, "https://"),
        ({"return_address": "javascript:alert(1)"}, "https://"),
        ({"return_address": "https://a.example/ ?c={code}"}, "https://"),
        ({"return_address": "https://a.example/?c={cod}"}, "{cod}"),
        ({"codes": EndingCodes(done="C1", left="C1")}, "paid as completed"),
    ],
)
def test_invalid_recruitment_site_has_problems(fields, words):
    found = [one.sentence(str) for one in recruiting_problems(Recruiting(**fields))]
    assert any(words in sentence for sentence in found), found


def test_a_complete_recruitment_site_has_no_problems():
    own = Recruiting(
        site="other", id_parameter="p", return_address="https://a.example/{session}?c={code}&i={id}"
    )
    assert list(recruiting_problems(own)) == []


def test_rules_name_a_questionnaire_of_the_study_and_an_answer():
    quota = AnswerQuota(questionnaire="other", item="i", answers=("a",))
    found = [one.sentence(str) for one in screening_problems([rule()], [quota], ["q"], ["q"])]
    assert len(found) == 2
    assert "names no answer" in found[0]
    assert "other" in found[1]
