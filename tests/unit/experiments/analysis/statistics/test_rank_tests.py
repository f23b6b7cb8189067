"""Tests of ranks against scipy, and against their own definitions."""

import itertools

import numpy as np
import pytest
from scipy import stats

from experiments.analysis.statistics.conditions import compare
from experiments.analysis.statistics.rank_tests import rank_sums, several_ranked, signed_ranks
from tests.support.examples import binomial_band, repetitions


def test_signed_ranks_are_those_of_scipy_and_pairs_without_a_difference_do_not_count():
    rng = np.random.default_rng(1)
    first, second = rng.integers(-2, 3, 30).astype(float), rng.integers(-2, 3, 30).astype(float)
    found = signed_ranks(first, second)
    moved = (first - second)[first != second]
    assert found.p == pytest.approx(stats.wilcoxon(moved).pvalue)
    assert found.n == 30
    assert found.remark == f"{30 - len(moved)} pairs without a difference do not count"
    ranks = stats.rankdata(np.abs(moved))
    up, down = ranks[moved > 0].sum(), ranks[moved < 0].sum()
    assert found.statistic == up
    assert (found.effect_name, found.effect.value) == (
        "r",
        pytest.approx((up - down) / (up + down)),
    )
    assert found.effect.low < found.effect.value < found.effect.high


def test_one_pair_without_a_difference_is_said_in_the_singular():
    found = signed_ranks(np.array([1.0, 2.0, 4.0, 8.0]), np.array([1.0, 1.0, 2.0, 3.0]))
    assert found.remark == "1 pair without a difference does not count"


def test_rank_sums_are_those_of_scipy_and_r_is_how_much_more_often_one_is_greater():
    rng = np.random.default_rng(2)
    first, second = rng.normal(0.5, 1.0, 14), rng.normal(0.0, 1.0, 11)
    found = rank_sums(first, second)
    assert found.p == pytest.approx(stats.mannwhitneyu(first, second, use_continuity=False).pvalue)
    pairs = [float(np.sign(a - b)) for a, b in itertools.product(first, second)]
    assert found.effect.value == pytest.approx(np.mean(pairs))
    differences = [a - b for a, b in itertools.product(first, second)]
    assert found.difference.value == pytest.approx(np.median(differences))
    assert found.difference.low < found.difference.value < found.difference.high


@pytest.mark.parametrize("is_paired", [True, False])
def test_the_interval_of_a_shift_holds_it_in_95_of_100_studies(is_paired):
    rng, studies = np.random.default_rng(3), repetitions(200, thorough=600)
    test = signed_ranks if is_paired else rank_sums
    found = [
        test(rng.normal(1.0, 1.0, 18), rng.normal(0.0, 1.0, 18)).difference for _ in range(studies)
    ]
    low, high = binomial_band(0.95, studies)
    assert low <= np.mean([one.low <= 1.0 <= one.high for one in found]) <= high


def test_several_groups_are_compared_as_scipy_compares_them():
    rng = np.random.default_rng(4)
    groups = [
        rng.integers(0, 5, size).astype(float) + shift for size, shift in ((9, 0), (12, 1), (8, 2))
    ]
    found = several_ranked(groups)
    expected = stats.kruskal(*groups)
    assert (found.statistic, found.p) == pytest.approx((expected.statistic, expected.pvalue))
    assert found.effect.value == pytest.approx(expected.statistic / 28)
    assert 0.0 <= found.effect.low < found.effect.value < found.effect.high <= 1.0
    assert several_ranked(groups) == found


def test_equal_values_get_words():
    same = np.ones(5)
    assert signed_ranks(same, same).remark == "no variance: all differences are equal"
    assert rank_sums(same, same).remark == "no variance"
    assert several_ranked([same, same, same]).remark == "no variance"
    assert signed_ranks(
        np.array([0.1 + 0.2, 1.0, 2.0]), np.array([0.3, 1.0, 2.0])
    ).remark.startswith("no variance")


def test_a_group_without_variance_is_ranked_like_any_other():
    groups = {
        "a": {f"P{n}": 2.0 for n in range(6)},
        "b": {f"Q{n}": float(n) for n in range(6)},
    }
    found = compare(groups, is_paired=False, by_ranks=True)
    assert (found.name, found.n, found.remark) == ("Mann-Whitney U", 12, "")
