"""Tests of means, proportions and relations, against SciPy, statsmodels and textbook formulas."""

import math

import numpy as np
import pytest
from scipy import optimize, stats
from statsmodels.stats.contingency_tables import cochrans_q
from statsmodels.stats.proportion import confint_proportions_2indep

from experiments.analysis.statistics.comparisons import (
    between,
    correlation,
    holm,
    repeated_measures,
    several_between,
    several_within,
    standardized,
    within,
)
from experiments.analysis.statistics.conditions import TESTS, compare, p_values
from experiments.analysis.statistics.proportions import paired_proportions, two_proportions


def people(*values):
    return {f"P{number}": value for number, value in enumerate(values)}


# --- means ----------------------------------------------------------------------------------------


def test_two_groups_have_scipys_welch_test_and_interval():
    rng = np.random.default_rng(3)
    first, second = rng.normal(1.0, 1.0, 17), rng.normal(0.3, 2.0, 23)
    found, expected = between(first, second), stats.ttest_ind(first, second, equal_var=False)
    assert (found.statistic, found.p) == pytest.approx((expected.statistic, expected.pvalue))
    assert found.df == pytest.approx((expected.df,))
    assert found.difference.value == pytest.approx(first.mean() - second.mean())
    assert (found.difference.low, found.difference.high) == pytest.approx(
        tuple(expected.confidence_interval())
    )


def test_d_divides_by_the_mean_variance_and_has_bonetts_interval():
    rng = np.random.default_rng(5)
    first, second = rng.normal(1.0, 1.0, 17), rng.normal(0.3, 2.0, 23)
    found = between(first, second).effect
    a, b = first.var(ddof=1), second.var(ddof=1)
    d = (first.mean() - second.mean()) / math.sqrt((a + b) / 2)
    error = d**2 * (a**2 / 16 + b**2 / 22) / (8 * ((a + b) / 2) ** 2)
    error += (a / 16 + b / 22) / ((a + b) / 2)
    assert found.value == pytest.approx(d)
    assert found.high - found.value == pytest.approx(1.959964 * math.sqrt(error))


def test_pairs_have_scipys_paired_test_and_interval():
    rng = np.random.default_rng(4)
    first = rng.normal(1.0, 1.0, 19)
    second = first + rng.normal(0.4, 0.5, 19)
    found, expected = within(first, second), stats.ttest_rel(first, second)
    assert (found.statistic, found.p) == pytest.approx((expected.statistic, expected.pvalue))
    assert found.df == (18.0,)
    assert (found.difference.low, found.difference.high) == pytest.approx(
        tuple(expected.confidence_interval())
    )
    differences = first - second
    assert found.effect.value == pytest.approx(differences.mean() / differences.std(ddof=1))


@pytest.mark.parametrize(("t", "n"), [(1.6, 39), (-8.3, 24)])
def test_interval_of_d_z_inverts_the_noncentral_t(t, n):
    found = standardized(t, n)
    for bound, share in ((found.low, 0.975), (found.high, 0.025)):

        def off(noncentrality, share=share):
            return stats.nct.cdf(t, n - 1, noncentrality) - share

        expected = optimize.brentq(off, t - 9, t + 9)
        assert bound * math.sqrt(n) == pytest.approx(expected, abs=1e-4)


def test_several_groups_have_welchs_analysis_of_variance():
    rng = np.random.default_rng(23)
    groups = [rng.normal(mean, 1.0 + mean, 15) for mean in (0.0, 0.5, 1.2)]
    found = several_between(groups)
    expected = stats.f_oneway(*groups, equal_var=False)
    assert (found.statistic, found.p) == pytest.approx((expected.statistic, expected.pvalue))
    f = stats.f_oneway(*groups).statistic
    assert (found.effect_name, found.effect.value) == (
        "η²p",
        pytest.approx(f * 2 / (f * 2 + 42)),
    )
    assert math.isnan(found.effect.low)


def greenhouse_geisser(table):
    """F, ε and p by the textbook: ε from the double-centred covariance of the conditions."""
    n, k = table.shape
    residual = table - table.mean(axis=0) - table.mean(axis=1, keepdims=True) + table.mean()
    error = (residual**2).sum() / ((n - 1) * (k - 1))
    f = n * table.mean(axis=0).var(ddof=1) / error
    s = np.cov(table.T)
    s = s - s.mean(axis=0) - s.mean(axis=1, keepdims=True) + s.mean()
    epsilon = np.trace(s) ** 2 / ((k - 1) * (s**2).sum())
    return f, epsilon, stats.f.sf(f, epsilon * (k - 1), epsilon * (k - 1) * (n - 1))


def test_conditions_within_have_the_corrected_analysis_of_variance():
    table = np.random.default_rng(6).normal((0.0, 0.5, 1.0, 0.2), (1.0, 1.0, 2.0, 4.0), (11, 4))
    found = several_within(table)
    f, epsilon, p = greenhouse_geisser(table)
    assert (found.statistic, found.p) == pytest.approx((f, p))
    assert found.df == pytest.approx((3 * epsilon, 30 * epsilon))
    assert found.effect.value == pytest.approx(f * 3 / (f * 3 + 30))


def test_two_conditions_within_have_the_paired_t_test():
    table = np.random.default_rng(8).normal(0.0, 1.0, (12, 2))
    _, df, p = repeated_measures(table)
    assert (df, p) == pytest.approx((1.0, stats.ttest_rel(*table.T).pvalue))


# --- proportions ----------------------------------------------------------------------------------


def zeros_and_ones(successes, n):
    return np.array([1.0] * successes + [0.0] * (n - successes))


def test_two_groups_of_proportions_have_the_n_minus_1_chi_square():
    found = two_proportions(zeros_and_ones(58, 63), zeros_and_ones(48, 64))
    table = [[58, 5], [48, 16]]
    chi2 = stats.chi2_contingency(table, correction=False).statistic * 126 / 127
    assert (found.name, found.df) == ("N−1 χ²", (1.0,))
    assert (found.statistic, found.p) == pytest.approx((chi2, stats.chi2.sf(chi2, 1)))
    low, high = confint_proportions_2indep(58, 63, 48, 64, method="newcomb")
    assert (found.difference.low, found.difference.high) == pytest.approx((low, high))
    assert found.difference.value == pytest.approx(58 / 63 - 48 / 64)


def test_rare_failures_have_an_exact_test():
    found = two_proportions(zeros_and_ones(9, 9), zeros_and_ones(11, 12))
    expected = stats.boschloo_exact([[9, 11], [0, 1]])
    assert (found.name, found.p) == ("Boschloo", pytest.approx(min(1.0, expected.pvalue)))


def test_steps_of_the_search_for_boschloos_p_are_not_logged(caplog):
    with caplog.at_level("INFO"):
        found = two_proportions(np.array([1.0, 0.0, 0.0, 0.0, 0.0]), np.zeros(4))
    assert found.name == "Boschloo"
    assert not caplog.records


def test_pairs_of_proportions_have_mcnemars_mid_p():
    first = np.array([1.0] * 8 + [0.0] * 2 + [1.0] * 20 + [0.0] * 5)
    second = np.array([0.0] * 8 + [1.0] * 2 + [1.0] * 20 + [0.0] * 5)
    found = paired_proportions(first, second)
    exact = stats.binomtest(2, 10).pvalue
    assert found.p == pytest.approx(exact - stats.binom.pmf(2, 10, 0.5))
    assert found.difference.value == pytest.approx(6 / 35)
    p, q = 9 / 37, 3 / 37
    slack = 1.959964 * math.sqrt((p + q - (p - q) ** 2) / 37)
    assert found.difference.high == pytest.approx(p - q + slack)


def test_as_many_successes_on_either_side_have_a_p_of_one():
    first = np.array([1.0, 1.0, 0.0, 0.0, 1.0])
    assert paired_proportions(first, np.array([0.0, 0.0, 1.0, 1.0, 1.0])).p == 1.0
    assert math.isnan(paired_proportions(first, first).p)


def test_several_conditions_of_proportions_have_cochrans_q():
    rng = np.random.default_rng(9)
    table = (rng.random((24, 4)) < (0.9, 0.7, 0.6, 0.5)).astype(float)
    found = compare(
        {f"c{n}": people(*column) for n, column in enumerate(table.T)},
        is_paired=True,
        by="proportions",
    )
    expected = cochrans_q(table)
    assert (found.name, found.statistic, found.p) == (
        "Cochran Q",
        pytest.approx(expected.statistic),
        pytest.approx(expected.pvalue),
    )


# --- relations and families -----------------------------------------------------------------------


def test_a_relation_is_scipys_without_missing_values():
    rng = np.random.default_rng(7)
    x = rng.normal(0.0, 1.0, 30)
    y = x + rng.normal(0.0, 1.0, 30)
    expected = stats.spearmanr(x[2:], y[2:])
    x[0], y[1] = math.nan, math.nan
    found = correlation(x, y)
    assert (found.n, found.effect.value, found.p) == pytest.approx(
        (28, expected.statistic, expected.pvalue)
    )
    rho = expected.statistic
    slack = 1.959964 * math.sqrt((1 + rho**2 / 2) / 25)
    assert found.effect.low == pytest.approx(math.tanh(math.atanh(rho) - slack))


def test_holms_correction_is_the_step_down_one():
    found = holm([0.01, math.nan, 0.04, 0.03])
    assert (found[0], found[2], found[3]) == pytest.approx((0.03, 0.06, 0.06))
    assert math.isnan(found[1])
    assert holm([0.9, 0.8]) == (1.0, 1.0)
    assert holm([]) == ()


def test_the_same_test_under_two_names_is_one_member_of_the_family():
    found = holm([0.01, 0.04, 0.04, 0.03], ["a", "b", "b", "c"])
    assert found == pytest.approx((0.03, 0.06, 0.06, 0.06))


# --- small and degenerate samples -----------------------------------------------------------------


@pytest.mark.parametrize("conditions", [2, 3])
@pytest.mark.parametrize("by", TESTS)
def test_too_few_participants_give_no_p_value_and_no_error(by, conditions):
    few = {f"c{n}": people(1.0) for n in range(conditions)}
    for is_paired in (True, False):
        assert math.isnan(compare(few, is_paired=is_paired, by=by).p)
    one_in_all = {f"c{n}": {f"P{n}": 0.0, "Q": 1.0} for n in range(conditions)}
    found = compare(one_in_all, is_paired=True, by=by)
    assert (found.n, found.remark) == (1, "fewer than two participants")
    assert math.isnan(correlation(np.ones(1), np.ones(1)).p)


@pytest.mark.parametrize("conditions", [2, 3])
@pytest.mark.parametrize("is_paired", [True, False])
@pytest.mark.parametrize("by", TESTS)
def test_participants_who_are_all_alike_give_no_error(by, is_paired, conditions):
    alike = {f"c{n}": people(*np.ones(5)) for n in range(conditions)}
    assert math.isnan(compare(alike, is_paired=is_paired, by=by).p)
    assert math.isnan(correlation(np.ones(5), np.arange(5.0)).p)


def test_without_variance_there_are_words_and_no_statistic():
    first = np.array([0.1, 0.2, 0.3, 0.7])
    shifted = within(first + 0.1, first)  # all differences are 0.1, but for rounding
    assert shifted.remark == "no variance: all differences are equal"
    assert math.isnan(shifted.statistic)
    assert shifted.difference.value == pytest.approx(0.1)
    moved = several_within(np.column_stack([first, first + 0.1, first - 0.2]))
    assert moved.remark == "no variance: all differences are equal"


def test_a_condition_of_one_participant_leaves_only_itself_out():
    rng = np.random.default_rng(25)
    groups = {
        "a": people(*rng.normal(0.0, 1.0, 9)),
        "b": people(3.0),
        "c": people(*rng.normal(1.0, 1.0, 8)),
        "e": people(),
    }
    found = compare(groups, is_paired=False)
    expected = stats.ttest_ind(*(list(groups[key].values()) for key in "ac"), equal_var=False)
    assert (found.name, found.n, found.p) == ("Welch t", 17, pytest.approx(expected.pvalue))
    assert found.remark == "b: left out, n = 1; e: left out, n = 0"


def test_groups_of_which_one_does_not_vary_are_compared_by_ranks():
    rng = np.random.default_rng(25)
    all_did_best, others = np.ones(12), rng.uniform(0.80, 0.84, 12)
    found = compare({"a": people(*all_did_best), "b": people(*others)}, is_paired=False)
    expected = stats.mannwhitneyu(all_did_best, others, use_continuity=False)
    assert (found.name, found.n) == ("Mann-Whitney U", 24)
    assert found.p == pytest.approx(expected.pvalue)
    assert found.difference.value == pytest.approx(1.0 - others.mean())
    assert math.isnan(found.difference.low)
    assert found.remark == "a: no variance, so compared by ranks"
    both = {"a": people(*all_did_best), "b": people(*np.full(12, 0.8))}
    assert compare(both, is_paired=False).p < 0.001
    three = compare({**both, "c": people(*others)}, is_paired=False)
    assert (three.name, three.p < 0.001) == ("Kruskal-Wallis H", True)
    assert three.remark == "a, b: no variance, so compared by ranks"


def test_a_condition_of_one_participant_does_not_end_the_others_tests_within():
    rng = np.random.default_rng(26)
    a, b = rng.normal(0.0, 1.0, 9), rng.normal(0.5, 1.0, 9)
    found = compare({"a": people(*a), "b": people(*b), "c": people(1.0)}, is_paired=True)
    assert found.p == pytest.approx(stats.ttest_rel(a, b).pvalue)
    assert (found.n, found.remark) == (9, "c: left out, n = 1")


def test_conditions_of_which_participants_have_some_are_compared_by_a_mixed_model():
    rng = np.random.default_rng(27)
    own = rng.normal(0.0, 1.0, (2, 12))
    groups = {
        f"{kind}{at}": {f"{kind}-{n}": own[kind, n] + rng.normal(at, 0.5) for n in range(12)}
        for kind in (0, 1)
        for at in (0, 1)
    }
    found = compare(groups, is_paired=None)
    assert (found.name, found.n, found.df[0]) == ("Wald F", 24, 3.0)
    assert found.p < 0.05
    assert compare(groups, is_paired=None, by="ranks").name == "–"
    alike = {
        key: {who: own[int(who[0]), int(who[2:])] for who in one} for key, one in groups.items()
    }
    assert compare(alike, is_paired=None).remark == "no variance within participants"


def test_fewer_than_two_conditions_are_not_compared():
    found = compare({"a": people(1.0, 2.0), "b": people(1.0)}, is_paired=False)
    assert (found.name, found.n) == ("–", 0)
    assert found.remark == "b: left out, n = 1; fewer than two conditions to compare"


# --- many studies at once -------------------------------------------------------------------------


@pytest.mark.parametrize("conditions", [2, 3])
@pytest.mark.parametrize("is_paired", [True, False])
@pytest.mark.parametrize("by", TESTS)
def test_many_studies_at_once_have_the_p_values_of_each(by, is_paired, conditions):
    rng = np.random.default_rng(12)
    samples = [rng.standard_normal((4, 20)) for _ in range(conditions)]
    if by == "proportions":
        samples = [(one < 1.0).astype(float) for one in samples]
    found = p_values(samples, is_paired=is_paired, by=by)
    for study in range(4):
        groups = {f"c{n}": people(*own[study]) for n, own in enumerate(samples)}
        assert found[study] == pytest.approx(compare(groups, is_paired=is_paired, by=by).p)
