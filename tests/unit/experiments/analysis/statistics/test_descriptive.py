"""Numbers that describe, against pandas and scipy."""

import itertools
import math

import numpy as np
import pandas
import pytest
from hypothesis import given, strategies as st
from scipy import stats

from experiments.analysis.statistics.descriptive import shares, spread, wilson
from experiments.analysis.tables.table import number
from tests.support.examples import examples


@examples(50, thorough=1000)
@given(st.lists(st.integers(0, 10_000), min_size=1, max_size=9))
def test_equal_counts_have_equal_percentages_and_all_have_all_digits(counts):
    found = shares(counts)
    if not sum(counts):
        assert found is None
        return
    assert found == pytest.approx([100.0 * count / sum(counts) for count in counts], rel=1e-15)
    for one, other in itertools.combinations(range(len(counts)), 2):
        assert (counts[one] == counts[other]) == (found[one] == found[other])


def test_three_equal_thirds_are_printed_alike():
    assert [number(share, 1).text for share in shares((1, 1, 1))] == ["33.3"] * 3


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
    assert found.iqr == pytest.approx(series.quantile(0.75) - series.quantile(0.25))


def test_no_value_and_one_value_have_a_spread():
    assert spread([]).median is None
    assert spread([math.nan]).n == 0
    one = spread([4.0])
    assert (one.n, one.mean, one.sd, one.p5, one.p95) == (1, 4.0, None, 4.0, 4.0)


def test_a_share_has_wilsons_bounds():
    found = wilson(116, 127)
    expected = stats.binomtest(116, 127).proportion_ci(method="wilson")
    assert found == pytest.approx((expected.low, expected.high))
    assert wilson(0, 0) is None
    assert wilson(5, 5) == pytest.approx((0.5655, 1.0), abs=1e-4)
