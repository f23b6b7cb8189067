"""Simulated power is the exact one wherever there is one, and comes from the statistics of the
report.
"""

import math

import msgspec
import numpy as np
import pytest

from experiments.analysis.power.exact import participants_needed, power
from experiments.analysis.power.search import (
    PowerOptions,
    least_participants,
    power_report,
    power_table,
)
from experiments.analysis.power.simulation import simulate, two_sides
from experiments.analysis.statistics.comparisons import (
    friedman,
    holm,
    holm_rows,
    several_between,
    several_within,
    welch_f,
)
from experiments.analysis.statistics.conditions import compare
from experiments.analysis.statistics.mixed_model_batch import term_p_values
from experiments.analysis.statistics.mixed_models import design_of, fit
from experiments.definition.plan import StudyPlan
from experiments.definition.shipped import shipped
from tests.support.analysis.powered import expected, powered_study

# effect in SD, correlation, participants (in all)
PAIRED = [(0.5, 0.5, 34), (0.4, 0.7, 30), (0.8, 0.2, 24)]
INDEPENDENT = [(0.5, 128), (0.8, 52), (0.3, 100)]
# weights of the conditions of a contrast within participants, and participants
CONTRASTS = [((2,), (0, 1), 30), ((0,), (1, 2), 40), ((2,), (0,), 24)]


def simulated(study, participants, studies):
    (found,) = simulate(study, participants, studies, seed=7).power(0.05)
    return found[0] / found[1]


def agree_paired(effect, correlation, people, studies, within):
    study = powered_study(expected=[expected(1, effect, correlation=correlation, sd=1.0)])
    d_z = effect / math.sqrt(2.0 * (1.0 - correlation))
    assert simulated(study, people, studies) == pytest.approx(
        power(d_z, people, "within"), abs=within
    )


def agree_independent(effect, people, studies, within):
    study = powered_study(design="between", expected=[expected(1, effect, sd=1.0)])
    exact = power(effect, people // 2, "between")
    assert simulated(study, people, studies) == pytest.approx(exact, abs=within)


def agree_contrast(first, second, people, studies, within):
    """A contrast of means of conditions whose values correlate by r has the variance
    (1/k + 1/m)(1 - r).
    """
    means, correlation = (0.0, 0.2, 0.6), 0.6
    declared = [
        expected(n, mean, sd=2.0, correlation=correlation)
        for n, mean in enumerate(2.0 * one for one in means)
    ]
    study = powered_study(3, first=first, second=second, expected=declared)
    difference = np.mean([means[n] for n in first]) - np.mean([means[n] for n in second])
    spread = math.sqrt((1 / len(first) + 1 / len(second)) * (1.0 - correlation))
    exact = power(difference / spread, people, "within")
    assert simulated(study, people, studies) == pytest.approx(exact, abs=within)


@pytest.mark.parametrize(("effect", "correlation", "people"), PAIRED)
def test_a_paired_t_test_has_its_exact_power(effect, correlation, people):
    agree_paired(effect, correlation, people, 2000, 0.03)


@pytest.mark.parametrize(("effect", "people"), INDEPENDENT)
def test_an_independent_t_test_has_its_exact_power(effect, people):
    agree_independent(effect, people, 2000, 0.03)


@pytest.mark.parametrize(("first", "second", "people"), CONTRASTS)
def test_a_contrast_within_participants_has_its_exact_power(first, second, people):
    agree_contrast(first, second, people, 2000, 0.03)


@pytest.mark.soak
def test_with_many_studies_the_power_is_exact_within_two_points():
    for case in PAIRED:
        agree_paired(*case, 5000, 0.02)
    for case in INDEPENDENT:
        agree_independent(*case, 5000, 0.02)
    for case in CONTRASTS:
        agree_contrast(*case, 5000, 0.02)


def test_the_least_number_is_the_one_of_the_tables():
    study = powered_study(expected=[expected(1, 0.5, correlation=0.5)])
    found = power_report(study, (34,), PowerOptions(seed=3, studies=4000))
    need = participants_needed(0.5, "within")
    assert abs(found.needed - need.total) <= 2
    table = power_table(study, found, 4000)
    assert table.notes[0].startswith(f"{found.needed} participants give every declared test")
    low, high = (table.rows[0][table.head.index(f"Power: {end}")].value for end in ("from", "to"))
    assert low < power(0.5, 34, "within") < high


def test_without_an_expected_difference_there_is_no_number():
    study = powered_study(expected=[expected(1, 0.0)])
    found = power_report(study, (20,), PowerOptions(studies=50))
    assert not found.is_searched
    assert "No difference is expected" in power_table(study, found, 50).notes[0]


def test_what_nobody_declares_is_half_a_standard_deviation():
    assert simulated(powered_study(), 34, 2000) == pytest.approx(power(0.5, 34, "within"), abs=0.03)


def test_the_same_seed_makes_the_same_studies():
    one, same, other = (simulate(powered_study(), 10, 20, seed) for seed in (1, 1, 2))
    assert (one.p == same.p).all()
    assert (one.p != other.p).any()


@pytest.mark.parametrize("is_between", [False, True])
@pytest.mark.parametrize("by_ranks", [False, True])
def test_simulated_studies_are_analysed_as_the_report_does(is_between, by_ranks):
    rng = np.random.default_rng(3)
    kinds = [("c0",), ("c1",)] if is_between else [("c0", "c1")]
    samples = [rng.standard_normal((3, 12, len(kind))) for kind in kinds]
    found = two_sides(kinds, samples, ("c1",), ("c0",), by_ranks=by_ranks)
    for number in range(3):
        values = np.concatenate([one[number] for one in samples], axis=1)
        groups = {
            side: {f"P{n:02d}": value for n, value in enumerate(values[:, column])}
            for side, column in (("first", 1), ("second", 0))
        }
        test = compare(groups, is_paired=not is_between, by_ranks=by_ranks)
        assert found[number] == pytest.approx(test.p)


def test_tests_of_several_conditions_are_those_of_the_report():
    rng = np.random.default_rng(5)
    tables = rng.standard_normal((4, 9, 3)).round(1)
    groups = [rng.standard_normal((4, n)) for n in (7, 8, 9)]
    for number in range(4):
        assert friedman(tables)[1][number] == pytest.approx(several_within(tables[number]).p)
        own = [group[number] for group in groups]
        assert welch_f(groups)[2][number] == pytest.approx(several_between(own).p)
    ps = rng.random((4, 5))
    assert [tuple(row) for row in holm_rows(ps)] == [pytest.approx(holm(row)) for row in ps]


def test_many_mixed_models_at_once_are_those_of_the_report():
    rng = np.random.default_rng(8)
    cells = [(a, b) for a in ("x", "y") for b in ("u", "v")]
    rows = [{"a": a, "b": b} for _ in range(10) for a, b in cells]
    who = [f"P{n // 4:02d}" for n in range(40)]
    terms = ("a", "b", "a:b")
    design = design_of({"a": ["x", "y"], "b": ["u", "v"]}, terms, rows, "sum")
    own = np.repeat(rng.standard_normal((6, 10)), 4, axis=1) * np.array([0, 0, 1, 1, 3, 9])[:, None]
    outcomes = own + rng.standard_normal((6, 40))
    found = term_p_values(outcomes, design, terms, who)
    for number, outcome in enumerate(outcomes):
        expected_ = [term.p for term in fit(outcome, design, terms, who).terms]
        assert found[number] == pytest.approx(expected_, rel=1e-5)


def test_the_effect_of_a_factor_in_a_mixed_model_has_about_the_power_of_its_contrast():
    """With two conditions, Wald's F test is the square of the paired t."""
    whole = msgspec.to_builtins(powered_study(expected=[expected(1, 0.5, correlation=0.5)]))
    about = {"key": "time", "title": {"en": "Time"}, "measures": ["task_time"]}
    whole["analyses"] = [{**about, "test": "mixed", "effects": ["condition"]}]
    study = msgspec.convert(whole, type(powered_study()))
    assert simulated(study, 34, 1000) == pytest.approx(power(0.5, 34, "within"), abs=0.04)


@pytest.mark.parametrize("name", list(shipped()))
def test_shipped_studies_can_be_simulated(name):
    study = shipped()[name]
    found = simulate(study, 24, 20, seed=1)
    assert len(found.tests) == sum(
        len(one.measures) * max(1, len(one.contrasts)) for one in study.analyses
    )
    assert np.isfinite(found.p).all()


def test_the_least_number_is_found_or_is_too_large():
    assert least_participants(lambda people: people / 100, 3, 0.8) == 81
    assert least_participants(lambda _: 0.1, 2, 0.8) is None
    assert least_participants(lambda _: 1.0, 2, 0.8) == 8
    assert StudyPlan().power == 0.8
