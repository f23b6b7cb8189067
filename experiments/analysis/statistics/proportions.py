"""Tests of proportions: each participant succeeded (1) or failed (0) in a condition.

Pearson's χ² with N - 1 in place of N (Campbell, 2007) is the rank-sum test of zeros and ones; where
an expected count is below 1, Boschloo's exact test is used. The difference of two proportions is
its own effect size; its interval is Newcombe's hybrid score, and of pairs that of Bonett and Price.
docs/explanation/statistics.md has the sources.
"""

import logging
import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import scipy

from experiments.analysis.statistics.comparisons import (
    EQUAL_DIFFERENCES,
    LOWER,
    NO_VARIANCE,
    TOO_FEW,
    UNKNOWN,
    IntervalEstimate,
    Test,
    Z,
)
from experiments.analysis.statistics.rank_tests import several_ranked
from experiments.dataset.columns import Floats

CHI_SQUARE, BOSCHLOO, MCNEMAR, COCHRAN = "N−1 χ²", "Boschloo", "McNemar mid-p", "Cochran Q"
LEAST_EXPECTED = 1.0  # successes or failures in a group, for χ² (Campbell, 2007)


def two_proportions(first: Floats, second: Floats) -> Test:
    from statsmodels.stats.proportion import confint_proportions_2indep  # noqa: PLC0415 - not on robots

    n, m = len(first), len(second)
    a, b = int(first.sum()), int(second.sum())
    low, high = confint_proportions_2indep(a, n, b, m, method="newcomb", alpha=2.0 * LOWER)
    difference = IntervalEstimate(a / n - b / m, float(low), float(high))
    if a + b in {0, n + m}:
        return Test(CHI_SQUARE, n + m, difference=difference, remark=NO_VARIANCE)
    p = float(two_proportions_p(first, second))
    if float(_least_expected(a, b, n, m)) < LEAST_EXPECTED:
        return Test(BOSCHLOO, n + m, _boschloo(a, b, n, m)[0], (), p, difference)
    chi2 = float(scipy.stats.kruskal(first, second).statistic)
    return Test(CHI_SQUARE, n + m, chi2, (1.0,), p, difference)


def paired_proportions(first: Floats, second: Floats) -> Test:
    """Compare two conditions; the statistic counts those who succeeded in the first one alone."""
    n = len(first)
    if n < 2:
        return Test(MCNEMAR, n, remark=TOO_FEW)
    alone, other = (int((first > second).sum()), int((second > first).sum()))
    # with one more pair of either kind, and two more pairs in all
    p, q = (alone + 1.0) / (n + 2.0), (other + 1.0) / (n + 2.0)
    slack = Z * math.sqrt((p + q - (p - q) ** 2) / (n + 2.0))
    low, high = max(-1.0, p - q - slack), min(1.0, p - q + slack)
    difference = IntervalEstimate((alone - other) / n, low, high)
    if not alone + other:
        return Test(MCNEMAR, n, difference=difference, remark=EQUAL_DIFFERENCES)
    return Test(MCNEMAR, n, float(alone), (), float(mcnemar_p(first, second)), difference)


def several_proportions(groups: Sequence[Floats]) -> Test:
    """Compare three or more groups of participants: the test of ranks of zeros and ones."""
    test = several_ranked(groups)
    return replace(test, name=CHI_SQUARE, effect_name="", effect=UNKNOWN)


def two_proportions_p(first: Floats, second: Floats) -> Floats:
    """Return the p values of groups of zeros and ones, (…, n) and (…, m); 1 where all are equal."""
    n, m = first.shape[-1], second.shape[-1]
    a, b = np.broadcast_arrays(first.sum(axis=-1), second.sum(axis=-1))
    with np.errstate(divide="ignore", invalid="ignore"):
        # χ² of a table of two rows and two columns; N - 1 in place of N
        spread = (a + b) * (n + m - a - b) * n * m / (n + m - 1.0)
        p = scipy.special.chdtrc(1.0, (a * (m - b) - b * (n - a)) ** 2 / spread)
    found = np.where(spread > 0.0, p, 1.0)
    for place in map(tuple, np.argwhere(_least_expected(a, b, n, m) < LEAST_EXPECTED)):
        found[place] = _boschloo(int(a[place]), int(b[place]), n, m)[1]
    return found


def _least_expected(a: Floats | int, b: Floats | int, n: int, m: int) -> Floats:
    return np.asarray(np.minimum(a + b, n + m - a - b) * (min(n, m) / (n + m)))


@cache
def _boschloo(a: int, b: int, n: int, m: int) -> tuple[float, float]:
    """Return Boschloo's statistic and p value of a of n successes against b of m."""
    if a + b in {0, n + m}:
        return math.nan, 1.0
    # SciPy's optimizer logs each of its steps at INFO, by the root logger itself
    root = logging.getLogger()
    root.addFilter(_is_not_of_scipy)
    try:
        found = scipy.stats.boschloo_exact([[a, b], [n - a, m - b]])
    finally:
        root.removeFilter(_is_not_of_scipy)
    return float(found.statistic), min(1.0, float(found.pvalue))


def _is_not_of_scipy(record: logging.LogRecord) -> bool:
    return record.module != "_shgo"


def mcnemar_p(first: Floats, second: Floats) -> Floats:
    """Return the mid-p values of pairs of zeros and ones, (…, n); 1 where all pairs are equal."""
    alone, other = (first > second).sum(axis=-1), (second > first).sum(axis=-1)
    least, total = np.minimum(alone, other), alone + other
    # with as many of either kind, the point counts in both tails: p is 1
    exact = scipy.stats.binom.cdf(least, total, 0.5) - scipy.stats.binom.pmf(least, total, 0.5) / 2
    return np.asarray(np.minimum(2.0 * exact, 1.0))
