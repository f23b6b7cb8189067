"""Tests that compare, against scipy, against published examples, and against planted effects."""

import math

import numpy as np
import pytest
from scipy import optimize, stats

from experiments.analysis.power.exact import participants_needed
from experiments.analysis.statistics.comparisons import (
    between,
    correlation,
    holm,
    paired,
    several_between,
    several_within,
    standardized,
    welch,
    within,
)
from experiments.analysis.statistics.conditions import compare

RUNS = 1000


def kendalls_w(table):
    """By its definition, for ranks without ties."""
    n, k = table.shape
    sums = stats.rankdata(table, axis=1).sum(axis=0)
    return 12.0 * ((sums - sums.mean()) ** 2).sum() / (n**2 * (k**3 - k))


def test_two_groups_are_compared_as_scipy_compares_them():
    rng = np.random.default_rng(3)
    first, second = rng.normal(1.0, 1.0, 17), rng.normal(0.3, 2.0, 23)
    found, expected = between(first, second), stats.ttest_ind(first, second, equal_var=False)
    assert (found.statistic, found.p) == pytest.approx((expected.statistic, expected.pvalue))
    assert found.difference.value == pytest.approx(first.mean() - second.mean())


def test_pairs_are_compared_as_scipy_compares_them():
    rng = np.random.default_rng(4)
    first = rng.normal(1.0, 1.0, 19)
    second = first + rng.normal(0.4, 0.5, 19)
    found, expected = within(first, second), stats.ttest_rel(first, second)
    assert (found.statistic, found.p) == pytest.approx((expected.statistic, expected.pvalue))
    assert found.effect.value == pytest.approx(
        (first - second).mean() / (first - second).std(ddof=1)
    )


def test_with_two_groups_welchs_f_is_the_square_of_welchs_t():
    rng = np.random.default_rng(5)
    first, second = rng.normal(1.0, 1.0, 12), rng.normal(0.0, 2.0, 15)
    assert several_between([first, second]).statistic == pytest.approx(
        float(welch(first, second)[0]) ** 2
    )
    assert several_between([first, second]).p == pytest.approx(float(welch(first, second)[1]))


def test_several_conditions_within_subjects_are_compared_by_friedmans_test():
    table = np.random.default_rng(6).normal((0.0, 1.0, 2.0), 1.0, (11, 3))
    expected = stats.friedmanchisquare(*table.T)
    found = several_within(table)
    assert (found.statistic, found.p) == pytest.approx((expected.statistic, expected.pvalue))
    assert found.effect.value == pytest.approx(kendalls_w(table))


def test_a_relation_is_that_of_scipy_without_what_is_missing():
    rng = np.random.default_rng(7)
    x = rng.normal(0.0, 1.0, 30)
    y = x + rng.normal(0.0, 1.0, 30)
    expected = stats.spearmanr(x[2:], y[2:])
    x[0], y[1] = math.nan, math.nan
    found = correlation(x, y)
    assert (found.n, found.effect.value, found.p) == pytest.approx(
        (28, expected.statistic, expected.pvalue)
    )


@pytest.mark.parametrize("size", [0, 1])
def test_too_few_participants_give_no_p_value_and_no_error(size):
    few, more = np.ones(size), np.array([1.0, 2.0, 3.0])
    for found in (
        between(few, more),
        within(few, few),
        several_between([few, more, more]),
        several_within(np.ones((size, 3))),
        correlation(few, few),
    ):
        assert math.isnan(found.p)


def test_participants_who_are_all_alike_give_no_error():
    same = np.ones(5)
    assert math.isnan(between(same, same).p)
    assert math.isnan(within(same, same).p)
    assert math.isnan(several_between([same, same, same]).p)
    assert math.isnan(several_within(np.ones((5, 3))).p)
    assert math.isnan(correlation(same, np.arange(5.0)).p)


def test_holms_correction_is_the_step_down_one():
    found = holm([0.01, math.nan, 0.04, 0.03])
    assert (found[0], found[2], found[3]) == pytest.approx((0.03, 0.06, 0.06))
    assert math.isnan(found[1])
    assert holm([0.9, 0.8]) == (1.0, 1.0)


@pytest.mark.parametrize(
    ("name", "sizes", "draws"),
    [("welch", (32, 32), 1), ("welch", (20, 44), 2), ("paired", (24, 24), 3)],
)
def test_a_planted_null_is_significant_in_3_to_7_of_100_studies(name, sizes, draws):
    rng = np.random.default_rng(1000 + draws)
    first = rng.lognormal(0.0, 0.4, (RUNS, sizes[0]))
    second = (
        rng.lognormal(0.0, 0.4, (RUNS, sizes[1]))
        if name == "welch"
        else first * rng.lognormal(0.0, 0.3, (RUNS, sizes[1]))
    )
    second = second if name == "welch" else second * np.exp(-(0.3**2) / 2.0)
    _, p = (welch if name == "welch" else paired)(first, second)
    assert 0.03 <= float((p < 0.05).mean()) <= 0.07


def test_a_planted_effect_is_found_as_often_as_its_power_says():
    rng = np.random.default_rng(11)
    n = participants_needed(0.6, "between").per_group
    _, p = welch(rng.normal(0.6, 1.0, (RUNS, n)), rng.normal(0.0, 1.0, (RUNS, n)))
    assert 0.76 <= float((p < 0.05).mean()) <= 0.84


@pytest.mark.slow
def test_a_planted_null_of_a_relation_is_significant_in_3_to_7_of_100_studies():
    rng = np.random.default_rng(12)
    found = [correlation(rng.normal(size=30), rng.normal(size=30)).p for _ in range(RUNS)]
    assert 0.03 <= float((np.array(found) < 0.05).mean()) <= 0.07


def test_the_intervals_of_a_difference_are_those_of_scipy():
    rng = np.random.default_rng(21)
    first, second = rng.normal(1.0, 1.0, 17), rng.normal(0.3, 2.0, 23)
    found = between(first, second)
    expected = stats.ttest_ind(first, second, equal_var=False)
    assert found.df == pytest.approx((expected.df,))
    assert (found.difference.low, found.difference.high) == pytest.approx(
        tuple(expected.confidence_interval())
    )
    same = within(first, second[:17])
    expected = stats.ttest_rel(first, second[:17])
    assert same.df == (16.0,)
    assert (same.difference.low, same.difference.high) == pytest.approx(
        tuple(expected.confidence_interval())
    )


@pytest.mark.parametrize(("size", "weight", "freedom"), [(0.5, 10.0, 38), (-1.7, 24.0, 23)])
def test_the_interval_of_a_standardized_difference_inverts_the_noncentral_t(size, weight, freedom):
    found = standardized(size, weight, freedom)
    t = size * math.sqrt(weight)
    for bound, share in ((found.low, 0.975), (found.high, 0.025)):

        def off(noncentrality, share=share):
            return stats.nct.cdf(t, freedom, noncentrality) - share

        expected = optimize.brentq(off, t - 9, t + 9)
        assert bound * math.sqrt(weight) == pytest.approx(expected, abs=1e-4)


def test_the_interval_of_d_holds_the_true_effect_in_95_of_100_studies():
    rng = np.random.default_rng(22)
    found = [
        between(rng.normal(0.8, 1.0, 20), rng.normal(0.0, 1.0, 20)).effect for _ in range(RUNS)
    ]
    held = np.mean([one.low <= 0.8 <= one.high for one in found])
    assert 0.93 <= held <= 0.97


def test_partial_eta_squared_is_that_of_the_ordinary_analysis_of_variance():
    rng = np.random.default_rng(23)
    groups = [rng.normal(mean, 1.0, 15) for mean in (0.0, 0.5, 1.2)]
    found = several_between(groups)
    f = stats.f_oneway(*groups).statistic
    assert found.effect_name == "η²p"
    assert found.effect.value == pytest.approx(f * 2 / (f * 2 + 42))
    for bound, share in ((found.effect.low, 0.975), (found.effect.high, 0.025)):
        ratio = bound / (1.0 - bound) * 45  # the noncentrality
        assert stats.ncf.cdf(f, 2, 42, ratio) == pytest.approx(share, abs=1e-3)


def test_kendalls_w_has_an_interval_of_resampled_participants_that_is_always_the_same():
    table = np.random.default_rng(24).normal((0.0, 0.6, 1.2), 1.0, (25, 3))
    found = several_within(table)
    assert (found.effect_name, found.df) == ("W (Kendall)", (2.0,))
    assert 0.0 <= found.effect.low < found.effect.value < found.effect.high <= 1.0
    assert several_within(table) == found


def test_without_variance_there_are_words_and_no_statistic():
    first = np.array([0.1, 0.2, 0.3, 0.7])
    shifted = within(first + 0.1, first)  # all differences are 0.1, but for rounding
    assert shifted.remark == "no variance: all differences are equal"
    assert math.isnan(shifted.statistic)
    assert shifted.difference.value == pytest.approx(0.1)
    both = between(np.full(4, 0.1 + 0.2), np.full(5, 0.3))
    assert both.remark == "no variance"
    assert math.isnan(both.statistic)
    assert np.isnan(welch(np.ones(4), np.zeros(4))[0])
    assert np.isnan(paired(np.ones(4), np.zeros(4))[0])


def people(*values):
    return {f"P{number}": value for number, value in enumerate(values)}


def test_a_condition_of_one_participant_or_without_variance_takes_only_itself_out():
    rng = np.random.default_rng(25)
    groups = {
        "a": people(*rng.normal(0.0, 1.0, 9)),
        "b": people(3.0),
        "c": people(*rng.normal(1.0, 1.0, 8)),
        "d": people(2.0, 2.0, 2.0),
        "e": people(),
    }
    found = compare(groups, is_paired=False)
    expected = stats.ttest_ind(*(list(groups[key].values()) for key in "ac"), equal_var=False)
    assert (found.name, found.n, found.p) == ("Welch t", 17, pytest.approx(expected.pvalue))
    assert found.remark == ("b: left out, n = 1; d: left out, no variance; e: left out, n = 0")


def test_within_participants_a_condition_of_hardly_anybody_does_not_end_the_others():
    rng = np.random.default_rng(26)
    a, b = rng.normal(0.0, 1.0, 9), rng.normal(0.5, 1.0, 9)
    found = compare({"a": people(*a), "b": people(*b), "c": people(1.0)}, is_paired=True)
    assert found.p == pytest.approx(stats.ttest_rel(a, b).pvalue)
    assert (found.n, found.remark) == (9, "c: left out, n = 1")


def test_nothing_left_to_compare_is_said():
    found = compare({"a": people(1.0, 2.0), "b": people(1.0)}, is_paired=False)
    assert (found.name, found.n) == ("–", 0)
    assert found.remark == "b: left out, n = 1; fewer than two conditions to compare"


def test_values_that_differ_by_rounding_are_ties():
    rng = np.random.default_rng(27)
    table = rng.integers(1, 4, (12, 3)) / 10.0
    noisy = table * (1.0 + rng.choice((-1e-15, 0.0, 1e-15), table.shape))
    assert several_within(noisy).p == several_within(table).p
    assert correlation(noisy[:, 0], noisy[:, 1]).p == correlation(table[:, 0], table[:, 1]).p


def test_the_same_test_under_two_names_is_one_member_of_the_family():
    found = holm([0.01, 0.04, 0.04, 0.03], ["a", "b", "b", "c"])
    assert found == pytest.approx((0.03, 0.06, 0.06, 0.06))
