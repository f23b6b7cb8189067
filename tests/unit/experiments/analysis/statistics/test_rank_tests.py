"""Tests of ranks against SciPy, and against their own definitions."""

import itertools
import math

import numpy as np
import pytest
from scipy import stats

from experiments.analysis.statistics.comparisons import correlation
from experiments.analysis.statistics.conditions import compare
from experiments.analysis.statistics.rank_tests import (
    rank_sums,
    several_ranked,
    several_ranked_within,
    signed_ranks,
)


def test_signed_ranks_use_all_pairs_for_p_and_difference():
    rng = np.random.default_rng(1)
    first, second = rng.integers(-2, 3, 30).astype(float), rng.integers(-2, 3, 30).astype(float)
    found = signed_ranks(first, second)
    differences = first - second
    assert found.p == pytest.approx(stats.wilcoxon(differences, zero_method="pratt").pvalue)
    zeros = int((differences == 0).sum())
    assert (found.n, found.remark) == (30, f"pairs without a difference: {zeros}")
    ranks = stats.rankdata(np.abs(differences))
    up, down = ranks[differences > 0].sum(), ranks[differences < 0].sum()
    assert found.statistic == up
    assert (found.effect_name, found.effect.value) == (
        "r",
        pytest.approx((up - down) / (up + down)),
    )
    walsh = [(a + b) / 2 for a, b in itertools.combinations_with_replacement(differences, 2)]
    assert found.difference.value == pytest.approx(np.median(walsh))


def test_few_pairs_with_ties_have_an_exact_p():
    differences = np.array([1.0, 1.0, 2.0, 2.0, 3.0, -1.0])
    ranks = stats.rankdata(np.abs(differences))
    sums = np.array([np.dot(signs, ranks) for signs in itertools.product((0, 1), repeat=6)])
    least = min(np.mean(sums >= 19.0), np.mean(sums <= 19.0))
    assert signed_ranks(differences, np.zeros(6)).p == pytest.approx(2 * least)


def test_rank_sums_are_those_of_scipy_and_r_is_how_much_more_often_one_is_greater():
    rng = np.random.default_rng(2)
    first, second = rng.normal(0.5, 1.0, 14), rng.normal(0.0, 1.0, 11)
    found = rank_sums(first, second)
    assert found.p == pytest.approx(stats.mannwhitneyu(first, second, use_continuity=False).pvalue)
    pairs = [float(np.sign(a - b)) for a, b in itertools.product(first, second)]
    assert found.effect.value == pytest.approx(np.mean(pairs))
    assert found.effect.low < found.effect.value < found.effect.high < 1.0
    differences = [a - b for a, b in itertools.product(first, second)]
    assert found.difference.value == pytest.approx(np.median(differences))
    assert found.difference.low < found.difference.value < found.difference.high


def test_groups_that_do_not_overlap_have_no_interval_of_r():
    found = rank_sums(np.arange(5.0), np.arange(10.0, 15.0))
    assert found.effect.value == -1.0
    assert math.isnan(found.effect.low)


def test_several_groups_are_compared_as_scipy_compares_them():
    rng = np.random.default_rng(4)
    groups = [
        rng.integers(0, 5, size).astype(float) + shift for size, shift in ((9, 0), (12, 1), (8, 2))
    ]
    found = several_ranked(groups)
    expected = stats.kruskal(*groups)
    assert (found.statistic, found.p) == pytest.approx((expected.statistic, expected.pvalue))
    assert found.effect.value == pytest.approx(expected.statistic / 28)
    assert math.isnan(found.effect.low)


def kendalls_w(table):
    """By its definition, for ranks without ties."""
    n, k = table.shape
    sums = stats.rankdata(table, axis=1).sum(axis=0)
    return 12.0 * ((sums - sums.mean()) ** 2).sum() / (n**2 * (k**3 - k))


def test_several_within_conditions_are_compared_by_friedmans_test_and_kendalls_w():
    table = np.random.default_rng(6).normal((0.0, 1.0, 2.0), 1.0, (11, 3))
    expected = stats.friedmanchisquare(*table.T)
    found = several_ranked_within(table)
    assert (found.statistic, found.p) == pytest.approx((expected.statistic, expected.pvalue))
    assert found.effect.value == pytest.approx(kendalls_w(table))
    assert math.isnan(found.effect.low)


def test_equal_values_get_words():
    same = np.ones(5)
    assert signed_ranks(same, same).remark == "no variance: all differences are equal"
    assert rank_sums(same, same).remark == "no variance"
    assert several_ranked([same, same, same]).remark == "no variance"
    assert several_ranked_within(np.ones((5, 3))).remark == "no variance"
    assert signed_ranks(
        np.array([0.1 + 0.2, 1.0, 2.0]), np.array([0.3, 1.0, 2.0])
    ).remark.startswith("no variance")


def test_values_that_differ_by_rounding_are_ties():
    rng = np.random.default_rng(27)
    table = rng.integers(1, 4, (12, 3)) / 10.0
    noisy = table * (1.0 + rng.choice((-1e-15, 0.0, 1e-15), table.shape))
    assert several_ranked_within(noisy).p == several_ranked_within(table).p
    assert correlation(noisy[:, 0], noisy[:, 1]).p == correlation(table[:, 0], table[:, 1]).p


def test_a_group_without_variance_is_ranked_like_any_other():
    groups = {
        "a": {f"P{n}": 2.0 for n in range(6)},
        "b": {f"Q{n}": float(n) for n in range(6)},
    }
    found = compare(groups, is_paired=False, by="ranks")
    assert (found.name, found.n, found.remark) == ("Mann-Whitney U", 12, "")
