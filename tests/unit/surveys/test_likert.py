"""The numbers of the results table, against the paper's and against an independent computation."""

import math
import statistics

import pytest
from hypothesis import given, strategies as st

from surveys.likert import half_width, likert_table, mean_and_sd, summarise
from surveys.questionnaires import shipped
from tests.support.examples import examples

SCALE = (-2, -1, 0, 1, 2)
RESPONSES = st.lists(
    st.dictionaries(st.sampled_from(["q1", "q2", "q3"]), st.sampled_from([*SCALE, None])),
    max_size=30,
)


def by_each(responses):
    """Responses of as many respondents."""
    return [(f"P{n}", answers) for n, answers in enumerate(responses)]


@pytest.mark.parametrize(
    ("interval", "ci95", "ci99"), [("normal", 0.1715, 0.2254), ("t", 0.1749, 0.2324)]
)
def test_the_published_number_of_respondents_and_spread_give_the_published_interval(
    interval, ci95, ci99
):
    assert half_width(0.70, 64, 0.95, interval) == pytest.approx(ci95, abs=5e-5)
    assert half_width(0.70, 64, 0.99, interval) == pytest.approx(ci99, abs=5e-5)


def test_percentages_pool_answers_and_the_rest_counts_respondents():
    responses = [{"q1": 2, "q2": 0}, {"q1": 1}, {"q1": None, "q2": -2}, {}, {"q3": 2}]
    row = summarise(by_each(responses), ["q1", "q2"], SCALE, interval="normal")
    assert (row.respondents, row.answers, row.counts) == (3, 4, (1, 0, 1, 1, 1))
    assert row.percentages == (25.0, 0.0, 25.0, 25.0, 25.0)
    scores = [1.0, 1.0, -2.0]
    assert row.mean == pytest.approx(statistics.mean(scores))
    assert row.sd == pytest.approx(statistics.stdev(scores))
    assert row.ci95 == pytest.approx(1.959964 * statistics.stdev(scores) / math.sqrt(3))
    assert row.positive == 50.0


def test_several_responses_of_one_respondent_are_one_value():
    answers = [{"q1": value} for value in (2, 1, -1, 0)]
    once = summarise(by_each(answers), ["q1"], SCALE, interval="t")
    twice = summarise(by_each(answers) * 2, ["q1"], SCALE, interval="t")
    assert (twice.respondents, twice.answers) == (4, 8)
    assert (twice.mean, twice.sd, twice.ci95) == (once.mean, once.sd, once.ci95)


@pytest.mark.parametrize("interval", ["normal", "t"])
def test_tables_of_no_and_of_one_respondent_are_computed(interval):
    without_respondents = summarise([], ["q1"], SCALE, interval=interval)
    assert (
        without_respondents.respondents,
        without_respondents.answers,
        without_respondents.percentages,
        without_respondents.mean,
        without_respondents.positive,
    ) == (0, 0, None, None, None)
    one = summarise([("P", {"q1": 1})], ["q1"], SCALE, interval=interval)
    assert (one.mean, one.sd, one.ci95, one.ci99, one.positive) == (1.0, None, None, None, 100.0)


def test_an_answer_that_the_scale_does_not_have_is_an_error():
    with pytest.raises(ValueError, match=r"outside the scale: \[7\]"):
        summarise([("P", {"q1": 7})], ["q1"], SCALE, interval="t")


@examples(50, thorough=1000)
@given(RESPONSES)
def test_percentages_sum_to_100_and_the_mean_lies_within_the_scale(responses):
    row = summarise(by_each(responses), ["q1", "q2"], SCALE, interval="t")
    assert row.answers == sum(row.counts)
    if row.percentages is not None:
        assert math.fsum(row.percentages) == pytest.approx(100.0)
        assert 0.0 <= row.positive <= 100.0
        assert SCALE[0] <= row.mean <= SCALE[-1]
    if row.sd is not None:
        assert 0.0 <= row.ci95 <= row.ci99


@examples(50, thorough=1000)
@given(st.lists(st.integers(-1000, 1000), min_size=2))
def test_mean_and_deviation_agree_with_the_standard_library(scores):
    mean, sd = mean_and_sd(scores)
    assert mean == pytest.approx(statistics.fmean(scores))
    assert sd == pytest.approx(statistics.stdev(scores))


def test_the_table_has_overall_then_topics_then_statements():
    table = likert_table(
        shipped()["experience"],
        by_each([{f"q{n}": 1 for n in range(1, 9)}] * 2),
        language="en",
        interval="t",
        overall="Overall",
    )
    assert [line.kind for line in table] == ["overall"] + ["topic"] * 4 + ["statement"] * 8
    assert [line.label for line in table][:5] == [
        "Overall",
        "Robot teleoperation",
        "Cognitive load",
        "Task complexity",
        "Interface design",
    ]
    assert [line.summary.answers for line in table][:5] == [16, 6, 2, 6, 2]
    assert all(line.summary.sd == 0.0 for line in table)


def test_a_questionnaire_that_is_not_scored_so_has_no_such_table():
    with pytest.raises(ValueError, match="ict is not scored"):
        likert_table(shipped()["ict"], [], language="en", interval="t", overall="Overall")
