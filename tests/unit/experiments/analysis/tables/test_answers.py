"""The tables show the effects planted in answers and driving, and few others."""

import functools
import math

import msgspec
import numpy as np
import pytest
from scipy import stats
from scipy.special import ndtr

from experiments.analysis.metrics.definitions import METRICS
from experiments.analysis.metrics.milestones import Milestones
from experiments.analysis.metrics.sessions import Measured
from experiments.analysis.tables.effects import compare_conditions
from experiments.analysis.tables.paper_tables import compare_answers
from experiments.bots.persona import Effect, Persona
from experiments.dataset.records import Dataset, ResponseRecord, SessionRecord
from experiments.definition.shipped import shipped
from tests.support.analysis.study_dataset import questionnaires, without
from tests.support.examples import binomial_band, repetitions

BETWEEN = msgspec.structs.replace(
    shipped()["exploration"], conditions=shipped()["exploration"].conditions[:2]
)
WITHIN = shipped()["assistance"]
RUNS, PARTICIPANTS = repetitions(150, thorough=1000), 40
SCALE = (-2, -1, 0, 1, 2)
QUESTIONS = questionnaires("experience")
ALONE = functools.reduce(without, [f"q{n}" for n in range(1, 9) if n != 2], QUESTIONS[0])


def study_of(study, opinion, scale=SCALE, item="q2"):
    """A study whose participants had one condition by turns, or all, and answered one statement by
    their opinion, in standard deviations.
    """
    keys = [one.key for one in study.conditions]
    sessions, responses = [], []
    for number in range(PARTICIPANTS):
        own = keys if study.allocation.design == "within" else [keys[number % len(keys)]]
        for order, key in enumerate(own, start=1):
            one = SessionRecord(
                f"{number}-{key}",
                f"P{number}",
                "giraff",
                condition=key,
                number=order,
                outcome="completed",
            )
            sessions.append(one)
            responses.append(
                ResponseRecord(
                    f"{one.id}-q",
                    "experience",
                    one.participant,
                    {item: opinion(number, key)},
                    session=one.id,
                )
            )
    return Dataset(
        study, sessions=tuple(sessions), responses=tuple(responses), questionnaires=(ALONE,)
    )


def bots(study, seed, *effects, item="q2"):
    """What bots answer."""
    people = [Persona(number, seed, effects) for number in range(PARTICIPANTS)]
    seen = {one.key: {"condition": one.key, "assist": one.assist} for one in study.conditions}
    return lambda number, key: SCALE[people[number].point(item, len(SCALE), seen[key])]


def anybody(study, rng):
    """What people answer who have opinions of their own, and none on the condition."""
    own = rng.standard_normal(PARTICIPANTS)
    drawn = {
        one.key: ndtr(0.7 * own + 0.7 * rng.standard_normal(PARTICIPANTS))
        for one in study.conditions
    }
    return lambda number, key: SCALE[int(drawn[key][number] * len(SCALE))]


def said(table, label, column="p"):
    (row,) = (row for row in table.rows if row[0].text == label)
    return row[table.head.index(column)].value


@pytest.mark.parametrize("study", [BETWEEN, WITHIN])
def test_an_effect_planted_in_the_bots_answers_is_found_in_its_row(study):
    key = study.conditions[-1].key
    table = compare_answers(study_of(study, bots(study, 5, Effect("q2", -1.5, {"condition": key}))))
    assert said(table, "Q2", "p (Holm)") < 0.05
    assert (
        said(table, "Q2", f"{key}: mean")
        < said(table, "Q2", f"{study.conditions[0].key}: mean") - 0.5
    )
    nothing = compare_answers(
        study_of(study, bots(study, 5, Effect("q2", 0.0, {"condition": key})))
    )
    assert said(nothing, "Q2") > 0.05


@pytest.mark.slow
@pytest.mark.parametrize("study", [BETWEEN, WITHIN])
def test_answers_without_an_effect_are_significant_in_five_of_a_hundred_studies(study):
    rng = np.random.default_rng(43)
    found = [said(compare_answers(study_of(study, anybody(study, rng))), "Q2") for _ in range(RUNS)]
    low, high = binomial_band(0.05, RUNS)
    assert low <= np.mean(np.array(found) < 0.05) <= high


@pytest.mark.slow
def test_driving_without_an_effect_is_significant_in_five_of_a_hundred_studies():
    rng = np.random.default_rng(41)
    found = [
        said(compare_conditions(Dataset(BETWEEN), driven(rng), ("task_time",)), "task_time")
        for _ in range(RUNS)
    ]
    low, high = binomial_band(0.05, RUNS)
    assert low <= np.mean(np.array(found) < 0.05) <= high


def driven(rng):
    """Sessions of a study between participants, two each, in which how long the task takes is the
    person's alone.
    """
    keys = [one.key for one in BETWEEN.conditions]
    nothing = {column.name: math.nan for column in METRICS}
    found = []
    for number in range(PARTICIPANTS):
        own = rng.lognormal(5.0, 0.3)
        for order in (1, 2):
            session = SessionRecord(
                f"{number}-{order}",
                f"P{number}",
                "giraff",
                condition=keys[number % 2],
                number=order,
                outcome="completed",
            )
            values = nothing | {"task_time": own * rng.lognormal(0.0, 0.1)}
            found.append(Measured(session, Milestones(), values, (), np.empty((0, 2))))
    return found


def test_rows_are_tested_as_scipy_does_and_overall_is_a_participants_mean():
    rng = np.random.default_rng(42)
    keys = [one.key for one in WITHIN.conditions]
    answers = rng.integers(-2, 3, (12, len(keys), 8))
    sessions = [
        SessionRecord(f"{n}-{c}", f"P{n}", "giraff", condition=key, number=c + 1)
        for n in range(12)
        for c, key in enumerate(keys)
    ]
    responses = [
        ResponseRecord(
            f"r{n}-{c}",
            "experience",
            f"P{n}",
            {f"q{q + 1}": int(answers[n, c, q]) for q in range(8)},
            session=f"{n}-{c}",
        )
        for n in range(12)
        for c in range(len(keys))
    ]
    table = compare_answers(
        Dataset(
            WITHIN,
            sessions=tuple(sessions),
            responses=tuple(responses[:-1]),
            questionnaires=QUESTIONS,
        )
    )
    whole = answers[:-1]  # the last one did not answer after every condition
    assert said(table, "Q3") == pytest.approx(
        stats.ttest_rel(whole[:, 0, 2], whole[:, 1, 2]).pvalue
    )
    assert said(table, "Overall") == pytest.approx(
        stats.ttest_rel(whole[:, 0].mean(axis=1), whole[:, 1].mean(axis=1)).pvalue
    )
    assert said(table, "Overall", f"{keys[0]}: n") == 12


def test_without_answers_or_with_one_condition_alone_there_is_nothing_to_test():
    assert compare_answers(Dataset(BETWEEN, questionnaires=QUESTIONS)).rows == ()
    one = ResponseRecord("r", "experience", "P", {"q1": 2}, session="s")
    session = SessionRecord("s", "P", "giraff", condition=BETWEEN.conditions[0].key)
    table = compare_answers(
        Dataset(BETWEEN, sessions=(session,), responses=(one,), questionnaires=QUESTIONS)
    )
    assert said(table, "Q1", f"{BETWEEN.conditions[0].key}: mean") == 2.0
    assert math.isnan(said(table, "Q1") or math.nan)


def test_a_topic_of_one_statement_is_no_second_member_of_the_family():
    rng = np.random.default_rng(44)
    table = compare_answers(study_of(WITHIN, anybody(WITHIN, rng)))
    same = [row for row in table.rows if row[table.head.index("n tested")].value]
    assert len(same) > 1
    assert len({row[table.head.index("p")].value for row in same}) == 1
    assert [row[table.head.index("p (Holm)")].value for row in same] == [
        row[table.head.index("p")].value for row in same
    ]


def test_medians_and_quartiles_stand_beside_the_means_of_ordinal_answers():
    rng = np.random.default_rng(45)
    key = WITHIN.conditions[0].key
    opinion = anybody(WITHIN, rng)
    table = compare_answers(study_of(WITHIN, opinion))
    given = [opinion(number, key) for number in range(PARTICIPANTS)]
    low, middle, high = np.percentile(given, (25, 50, 75))
    assert said(table, "Q2", f"{key}: median") == middle
    assert said(table, "Q2", f"{key}: IQR") == high - low
