"""Scores with a rule of their own."""

import pytest

from surveys.questionnaires import shipped
from surveys.scoring import measured_scale, parts_of, scales_of, scores
from tests.support.studies.questionnaires import defined, item, rows


def score(slug: str, answers: list) -> float | None:
    """Return the one score of answers to all questions of a shipped questionnaire, in order."""
    definition = shipped()[slug]
    keys = [question.key for question in definition.questions()]
    (found,) = scores(definition, dict(zip(keys, answers, strict=True))).values()
    return found


@pytest.mark.parametrize(
    ("answers", "expected"),
    [
        ([5, 1] * 5, 100.0),
        ([1, 5] * 5, 0.0),
        ([3] * 10, 50.0),
        ([4, 2, 4, 2, 4, 2, 4, 2, 4, 2], 75.0),
        ([5, 2, 4, 1, 3, 3, 5, 2, 4, 1], 80.0),
    ],
)
def test_sus_counts_odd_items_up_and_even_items_down(answers, expected):
    assert score("sus", answers) == expected


def test_the_raw_tlx_is_the_mean_of_six_scales():
    assert score("tlx", [10, 20, 30, 40, 50, 60]) == 35.0


def test_a_missing_answer_leaves_no_score():
    assert score("sus", [3] * 9 + [None]) is None
    assert score("tlx", [10] * 5 + [None]) is None


def test_a_questionnaire_scores_its_responses_by_its_own_rule():
    known = shipped()
    assert scores(known["sus"], {f"sus{n}": 3 for n in range(1, 11)}) == {"sus": 50.0}
    assert scores(known["tlx"], {"mental": 10}) == {"tlx_raw": None}
    assert scores(known["ict"], {"computer": 4}) == {}
    experience = scores(known["experience"], {"q1": 2, "q2": 1, "q4": -1, "q7": None})
    topics = {"teleoperation": 1.5, "load": -1, "complexity": None, "interface": None}
    expected = {f"score_{topic}": value for topic, value in topics.items()}
    assert experience == {"score": pytest.approx(2 / 3)} | expected


def topic(key, *items):
    return {"key": key, "text": {"en": key.title()}, "items": list(items)}


OWN = defined(
    [
        item("likert", "warm"),
        item("likert", "cold", reverse=True),
        item("grid", "g", rows=[*rows("fast"), rows("slow")[0] | {"reverse": True}]),
        item("slider", "calm", maximum=10),
        item("slider", "tense", maximum=10, reverse=True),
    ],
    scoring="topics",
    topics=[
        topic("warmth", "warm", "cold"),
        topic("speed", "fast", "slow"),
        topic("ease", "calm", "tense"),
    ],
)


def test_reverse_coded_items_count_from_the_other_end_of_their_scale():
    given = {"warm": 1, "cold": -1, "fast": 0, "slow": 1, "calm": 2, "tense": 9}
    assert OWN.reversed == ["cold", "slow", "tense"]
    assert OWN.coded(given) == {**given, "cold": 1, "slow": -1, "tense": 1}
    assert scores(OWN, given) == {"score_warmth": 1.0, "score_speed": -0.5, "score_ease": 1.5}
    assert scores(OWN, {"cold": 1})["score_warmth"] == -1.0
    assert OWN.coded({"cold": None}) == {"cold": None}


def test_topics_that_are_scales_of_their_own_have_no_score_of_the_whole():
    assert "overall" not in {scale.key for scale in scales_of(OWN)}
    assert measured_scale(OWN, "overall") is None
    assert measured_scale(OWN, "warmth").items == ("warm", "cold")
    assert measured_scale(OWN, "cold").score(OWN.coded({"cold": 1})) == -1
    assert measured_scale(shipped()["ict"], "overall") is None


def test_the_tlx_alone_has_six_parts_and_the_sus_goes_to_100():
    assert [scale.key for scale in parts_of(shipped()["tlx"])][3] == "performance"
    assert parts_of(shipped()["sus"]) == ()
    assert scales_of(shipped()["sus"])[0].bounds == (0.0, 100.0)
