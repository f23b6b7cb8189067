"""Simulated power is the exact one wherever there is one, and is corrected in the families of the
report.
"""

import math

import msgspec
import numpy as np
import pytest
from statsmodels.stats.power import NormalIndPower
from statsmodels.stats.proportion import proportion_effectsize

from experiments.analysis.power.exact import participants_needed, power
from experiments.analysis.power.search import (
    PowerOptions,
    least_participants,
    power_report,
    power_table,
)
from experiments.analysis.power.simulation import simulate
from experiments.analysis.statistics.comparisons import holm, holm_rows
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


def test_default_difference_is_half_a_standard_deviation():
    assert simulated(powered_study(), 34, 2000) == pytest.approx(power(0.5, 34, "within"), abs=0.03)


def test_the_same_seed_makes_the_same_studies():
    one, same, other = (simulate(powered_study(), 10, 20, seed) for seed in (1, 1, 2))
    assert (one.p == same.p).all()
    assert (one.p != other.p).any()


def test_families_are_corrected_row_by_row():
    ps = np.random.default_rng(5).random((4, 5))
    assert [tuple(row) for row in holm_rows(ps)] == [pytest.approx(holm(row)) for row in ps]


def with_contrasts(study, pairs, **plan):
    """The study with a contrast for each pair of its conditions, by number."""
    whole = msgspec.to_builtins(study)
    contrasts = [
        {"title": {"en": f"{a}-{b}"}, "first": [f"c{a}"], "second": [f"c{b}"]} for a, b in pairs
    ]
    whole["analyses"] = [{**whole["analyses"][0], "contrasts": contrasts}]
    whole["plan"] |= plan
    return msgspec.convert(whole, type(study))


PAIRS = [(1, 0), (2, 0), (3, 0), (2, 1), (3, 1), (3, 2)]


def test_tests_that_are_assumed_null_are_in_the_family():
    """The report corrects six contrasts, so Bonferroni's sixth bounds the power from below."""
    hypotheses = [{"key": "h1", "text": "It helps.", "analysis": "time", "contrast": 1}]
    study = powered_study(4, expected=[expected(1, 0.6, sd=1.0, correlation=0.5)])
    found = simulate(with_contrasts(study, PAIRS, hypotheses=hypotheses), 28, 2000, seed=3)
    assert [one.is_null for one in found.tests] == [False, True, True, False, False, True]
    alone = power(0.6, 28, "within")
    corrected = power(0.6, 28, "within", 0.05 / 6)
    hits, studies = found.power(0.05)[0]
    assert corrected - 0.03 <= hits / studies < alone - 0.1


def test_a_default_effect_is_alone_in_its_family():
    study = with_contrasts(powered_study(4), PAIRS)
    found = simulate(study, 34, 2000, seed=4)
    for hits, studies in found.power(0.05):
        assert hits / studies == pytest.approx(power(0.5, 34, "within", 0.05 / 6), abs=0.05)


def test_a_family_of_the_plan_has_its_hypotheses_alone():
    hypotheses = [{"key": "h1", "text": "It helps.", "analysis": "time", "contrast": 1}]
    families = [{"key": "f", "hypotheses": ["h1"]}]
    study = powered_study(4, expected=[expected(1, 0.6, sd=1.0, correlation=0.5)])
    planned = with_contrasts(study, PAIRS, hypotheses=hypotheses, families=families)
    hits, studies = simulate(planned, 28, 2000, seed=3).power(0.05)[0]
    assert hits / studies == pytest.approx(power(0.6, 28, "within"), abs=0.03)


def of_kind(measure, test, level, other, design="between", **more):
    """A study with a proportion, count or time, and the expected values of both conditions."""
    levels = [expected(n, 0.0, level=one) for n, one in enumerate((level, other))]
    whole = msgspec.to_builtins(
        powered_study(design=design, expected=[{**one, "measure": measure} for one in levels])
    )
    whole["analyses"] = [{**whole["analyses"][0], "measures": [measure], "test": test, **more}]
    return msgspec.convert(whole, type(powered_study()))


def test_success_is_simulated_as_a_proportion():
    study = of_kind("completed", "proportions", 0.9, 0.6)
    effect = proportion_effectsize(0.9, 0.6)
    exact = NormalIndPower().power(effect, 40, 0.05)
    assert simulated(study, 80, 2000) == pytest.approx(exact, abs=0.05)
    assert simulated(of_kind("completed", "proportions", 0.8, 0.8), 80, 2000) == pytest.approx(
        0.05, abs=0.02
    )


def test_success_of_the_same_participants_has_a_null_of_5_percent():
    study = of_kind("completed", "proportions", 0.7, 0.7, design="within")
    assert 0.02 <= simulated(study, 40, 2000) <= 0.07


@pytest.mark.parametrize(
    ("test", "measure", "level"), [("counts", "stops", 2.0), ("times", "task_time", 300.0)]
)
def test_counts_and_times_are_simulated_by_their_own_models(test, measure, level):
    null = of_kind(measure, test, level, level)
    assert simulated(null, 40, 200) == pytest.approx(0.05, abs=0.06)
    study = of_kind(measure, test, level, 3.0 * level)
    assert simulated(study, 40, 100) > 0.5


def test_a_model_of_success_is_simulated_with_its_effects():
    effects = {"contrasts": [], "effects": ["condition"]}
    study = of_kind("completed", "proportions", 0.9, 0.4, design="within", **effects)
    found = simulate(study, 30, 50, seed=2)
    assert [one.label for one in found.tests] == ["condition"]
    hits, studies = found.power(0.05)[0]
    assert hits / studies > 0.8


def test_effects_without_an_assumption_are_in_the_family_of_the_model():
    whole = msgspec.to_builtins(powered_study(4))
    names = {"a": ("x", "y"), "b": ("u", "v")}
    whole["factors"] = [
        {
            "key": key,
            "title": {"en": key},
            "design": "within",
            "levels": [{"key": level, "title": {"en": level}} for level in levels],
        }
        for key, levels in names.items()
    ]
    cells = [{"a": a, "b": b} for a in names["a"] for b in names["b"]]
    for condition, levels in zip(whole["conditions"], cells, strict=True):
        condition["levels"] = levels
    about = {"key": "time", "title": {"en": "Time"}, "measures": ["task_time"], "test": "mixed"}
    whole["analyses"] = [{**about, "effects": ["a", "b", "a:b"], "covariates": ["age"]}]
    study = msgspec.convert(whole, type(powered_study()))
    found = simulate(study, 24, 1000, seed=5)
    assert [(one.label, one.is_null) for one in found.tests] == [
        ("a", False),
        ("b", False),
        ("a:b", True),
    ]
    (a, _), (b, _), (crossing, studies) = found.power(0.05)
    assert a / studies == pytest.approx(b / studies, abs=0.06)
    assert crossing / studies < 0.05


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
