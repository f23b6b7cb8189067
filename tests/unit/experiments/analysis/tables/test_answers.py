"""The tables show the effects planted in answers and driving, and few others."""

import functools
import math
from itertools import product

import msgspec
import numpy as np
import pytest
from scipy import stats
from scipy.special import ndtr

from experiments.analysis.tables.effects import compare_conditions
from experiments.analysis.tables.paper_tables import compare_answers
from experiments.bots.persona import Effect, Persona
from experiments.dataset.records import Dataset, ResponseRecord, SessionRecord
from experiments.definition.shipped import shipped
from tests.support.analysis.study_dataset import questionnaires, without
from tests.support.analysis.tables import labelled, measured
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
            sessions.append(session(number, order, key))
            responses.append(answered(sessions[-1], {item: opinion(number, key)}))
    return dataset_of(study, sessions, responses, ALONE)


def session(number, order, key):
    place = {"condition": key, "number": order, "outcome": "completed"}
    return SessionRecord(f"{number}-{key}-{order}", f"P{number}", "giraff", **place)


def answered(one, values):
    return ResponseRecord(f"{one.id}-q", "experience", one.participant, values, session=one.id)


def dataset_of(study, sessions, responses, *asked):
    rows = {"sessions": tuple(sessions), "responses": tuple(responses)}
    return Dataset(study, **rows, questionnaires=asked)


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


def number(table, label, column="p"):
    return labelled(table)[label][table.head.index(column)].value


@pytest.mark.parametrize("study", [BETWEEN, WITHIN])
def test_an_effect_planted_in_the_bots_answers_is_found_in_its_row(study):
    key = study.conditions[-1].key

    def table(size):
        effect = Effect("q2", size, {"condition": key})
        return compare_answers(study_of(study, bots(study, 5, effect)))

    found = table(-1.5)
    assert number(found, "Q2", "p (Holm)") < 0.05
    other = number(found, "Q2", f"{study.conditions[0].key}: mean")
    assert number(found, "Q2", f"{key}: mean") < other - 0.5
    assert number(table(0.0), "Q2") > 0.05


@pytest.mark.slow
@pytest.mark.parametrize("study", [BETWEEN, WITHIN])
def test_answers_without_an_effect_are_significant_in_five_of_a_hundred_studies(study):
    rng = np.random.default_rng(43)
    tables = (compare_answers(study_of(study, anybody(study, rng))) for _ in range(RUNS))
    found = [number(table, "Q2") for table in tables]
    low, high = binomial_band(0.05, RUNS)
    assert low <= np.mean(np.array(found) < 0.05) <= high


@pytest.mark.slow
def test_driving_without_an_effect_is_significant_in_five_of_a_hundred_studies():
    rng = np.random.default_rng(41)
    found = [
        number(compare_conditions(Dataset(BETWEEN), task_times(rng), ("task_time",)), "task_time")
        for _ in range(RUNS)
    ]
    low, high = binomial_band(0.05, RUNS)
    assert low <= np.mean(np.array(found) < 0.05) <= high


def task_times(rng):
    """Sessions of a study between participants, two each, in which how long the task takes is the
    person's alone.
    """
    keys = [one.key for one in BETWEEN.conditions]
    found = []
    for number in range(PARTICIPANTS):
        own = rng.lognormal(5.0, 0.3)
        for order in (1, 2):
            time = own * rng.lognormal(0.0, 0.1)
            found.append(measured(session(number, order, keys[number % 2]), task_time=time))
    return found


def test_rows_are_tested_as_scipy_does_and_overall_is_a_participants_mean():
    rng = np.random.default_rng(42)
    keys = [one.key for one in WITHIN.conditions]
    answers = rng.integers(-2, 3, (12, len(keys), 8))
    sessions, responses = [], []
    for n, (c, key) in product(range(12), enumerate(keys)):
        sessions.append(session(n, c + 1, key))
        values = {f"q{q + 1}": int(answers[n, c, q]) for q in range(8)}
        responses.append(answered(sessions[-1], values))
    table = compare_answers(dataset_of(WITHIN, sessions, responses[:-1], *QUESTIONS))
    whole = answers[:-1]  # the last one did not answer after every condition
    assert number(table, "Q3") == pytest.approx(
        stats.ttest_rel(whole[:, 0, 2], whole[:, 1, 2]).pvalue
    )
    assert number(table, "Overall") == pytest.approx(
        stats.ttest_rel(whole[:, 0].mean(axis=1), whole[:, 1].mean(axis=1)).pvalue
    )
    assert number(table, "Overall", f"{keys[0]}: n") == 12


def test_without_answers_or_with_one_condition_alone_there_is_nothing_to_test():
    assert compare_answers(Dataset(BETWEEN, questionnaires=QUESTIONS)).rows == ()
    one = ResponseRecord("r", "experience", "P", {"q1": 2}, session="s")
    session = SessionRecord("s", "P", "giraff", condition=BETWEEN.conditions[0].key)
    table = compare_answers(
        Dataset(BETWEEN, sessions=(session,), responses=(one,), questionnaires=QUESTIONS)
    )
    assert number(table, "Q1", f"{BETWEEN.conditions[0].key}: mean") == 2.0
    assert math.isnan(number(table, "Q1") or math.nan)


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
    assert number(table, "Q2", f"{key}: median") == middle
    assert number(table, "Q2", f"{key}: IQR") == high - low
