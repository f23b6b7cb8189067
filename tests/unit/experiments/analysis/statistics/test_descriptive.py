"""Numbers that describe and compare, against pandas and scipy, and against planted effects."""

import math

import numpy as np
import pandas
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from experiments.analysis.statistics.descriptive import (
    between,
    correlation,
    holm,
    paired,
    several_between,
    several_within,
    shares,
    spread,
    welch,
    wilson,
    within,
)
from experiments.definition.power import participants_needed

RUNS = 1000


@given(st.lists(st.integers(0, 10_000), min_size=1, max_size=9), st.integers(0, 3))
def test_percentages_sum_to_exactly_100_and_none_is_off_by_more_than_a_unit(counts, decimals):
    found = shares(counts, decimals)
    if not sum(counts):
        assert found is None
        return
    assert found is not None
    assert sum(round(share * 10**decimals) for share in found) == 100 * 10**decimals
    for share, count in zip(found, counts, strict=True):
        assert abs(share - 100.0 * count / sum(counts)) < 10.0**-decimals + 1e-9
        assert count or share == 0.0


def test_three_equal_thirds_are_printed_as_33_4_33_3_and_33_3():
    assert shares((1, 1, 1)) == (33.4, 33.3, 33.3)


def test_a_spread_is_that_of_pandas():
    values = np.random.default_rng(2).gamma(2.0, 3.0, 41)
    series = pandas.Series(values)
    found = spread([*values.tolist(), math.nan])
    assert found.n == 41
    assert found.mean == pytest.approx(series.mean())
    assert found.sd == pytest.approx(series.std())
    assert (found.p5, found.median, found.p95) == pytest.approx(
        tuple(series.quantile([0.05, 0.5, 0.95]))
    )


def test_nothing_and_one_value_have_a_spread():
    assert spread([]).median is None
    assert spread([math.nan]).n == 0
    one = spread([4.0])
    assert (one.n, one.mean, one.sd, one.p5, one.p95) == (1, 4.0, None, 4.0, 4.0)


def test_two_groups_are_compared_as_scipy_compares_them():
    rng = np.random.default_rng(3)
    first, second = rng.normal(1.0, 1.0, 17), rng.normal(0.3, 2.0, 23)
    found, expected = between(first, second), stats.ttest_ind(first, second, equal_var=False)
    assert (found.statistic, found.p) == pytest.approx((expected.statistic, expected.pvalue))
    assert found.difference == pytest.approx(first.mean() - second.mean())


def test_pairs_are_compared_as_scipy_compares_them():
    rng = np.random.default_rng(4)
    first = rng.normal(1.0, 1.0, 19)
    second = first + rng.normal(0.4, 0.5, 19)
    found, expected = within(first, second), stats.ttest_rel(first, second)
    assert (found.statistic, found.p) == pytest.approx((expected.statistic, expected.pvalue))
    assert found.effect == pytest.approx((first - second).mean() / (first - second).std(ddof=1))


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
    assert 0.0 <= found.effect <= 1.0


def test_a_relation_is_that_of_scipy_without_what_is_missing():
    rng = np.random.default_rng(7)
    x = rng.normal(0.0, 1.0, 30)
    y = x + rng.normal(0.0, 1.0, 30)
    expected = stats.spearmanr(x[2:], y[2:])
    x[0], y[1] = math.nan, math.nan
    found = correlation(x, y)
    assert (found.n, found.effect, found.p) == pytest.approx(
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


def test_a_share_has_wilsons_bounds():
    found = wilson(116, 127)
    expected = stats.binomtest(116, 127).proportion_ci(method="wilson")
    assert found == pytest.approx((expected.low, expected.high))
    assert wilson(0, 0) is None
    assert wilson(5, 5) == pytest.approx((0.5655, 1.0), abs=1e-4)


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


def test_a_planted_null_of_a_relation_is_significant_in_3_to_7_of_100_studies():
    rng = np.random.default_rng(12)
    found = [correlation(rng.normal(size=30), rng.normal(size=30)).p for _ in range(RUNS)]
    assert 0.03 <= float((np.array(found) < 0.05).mean()) <= 0.07
