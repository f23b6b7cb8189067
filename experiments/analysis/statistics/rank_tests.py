"""Tests of ranks, for ordinal answers and for values that no normal distribution describes. Each
asks whether distributions are the same; where spreads differ, it may reject though the middles are
equal.

Pairs without a difference are ranked, and their ranks dropped (Pratt, 1959), so that p value,
difference and interval are of the same pairs. A difference is the median of the Walsh averages or
of all differences (Hodges and Lehmann, 1963), its interval their order statistics. p values are
exact up to 50 pairs, or 8 participants in a group, without ties, and up to 13 pairs with them;
otherwise normal approximations corrected for ties. docs/explanation/statistics.md has the sources,
also of the effects r (Kerby, 2014) and ε² = H / (n - 1) (Tomczak and Tomczak, 2014).
"""

import math
from collections.abc import Sequence

import numpy as np
import scipy

from experiments.analysis.statistics.comparisons import (
    EQUAL_DIFFERENCES,
    NO_VARIANCE,
    TOO_FEW,
    IntervalEstimate,
    Test,
    Z,
    by_fisher,
    tied,
)
from experiments.dataset.columns import Floats

SIGNED, RANK_SUM, KRUSKAL = "Wilcoxon signed rank", "Mann-Whitney U", "Kruskal-Wallis H"
FRIEDMAN = "Friedman χ²"


def signed_ranks(first: Floats, second: Floats) -> Test:
    """Compare two conditions of the same participants; the statistic sums the positive ranks."""
    n = len(first)
    if n < 2:
        return Test(SIGNED, n, remark=TOO_FEW)
    differences = tied(first - second)
    # a difference that is rounding alone is none
    scale = float(np.abs(np.concatenate((first, second))).max(initial=0.0))
    differences = np.where(np.abs(differences) <= 1e-12 * scale, 0.0, differences)
    if not differences.any():
        return Test(SIGNED, n, difference=IntervalEstimate(0.0), remark=EQUAL_DIFFERENCES)
    ranks = scipy.stats.rankdata(np.abs(differences)) * (differences != 0.0)
    positive = float(ranks[differences > 0.0].sum())
    walsh = (differences[:, None] + differences[None, :])[np.triu_indices(n)] / 2.0
    slack = Z * math.sqrt(n * (n + 1.0) * (2.0 * n + 1.0) / 24.0)
    location = _median(walsh, n * (n + 1.0) / 4.0 - slack)
    effect = IntervalEstimate(2.0 * positive / float(ranks.sum()) - 1.0)
    zeros = int((differences == 0.0).sum())
    remark = f"pairs without a difference: {zeros}" if zeros else ""
    p = float(signed_rank_p(differences))
    return Test(SIGNED, n, positive, (), p, location, "r", effect, remark)


def rank_sums(first: Floats, second: Floats) -> Test:
    """Compare two groups of two or more participants each; the statistic is U of the first."""
    n, m = len(first), len(second)
    values = tied(np.concatenate((first, second)))
    if (values == values[0]).all():
        return Test(RANK_SUM, n + m, difference=IntervalEstimate(0.0), remark=NO_VARIANCE)
    x, y = np.split(values, [n])
    u, p = map(float, scipy.stats.mannwhitneyu(x, y, use_continuity=False))
    slack = Z * math.sqrt(n * m * (n + m + 1.0) / 12.0)
    location = _median((x[:, None] - y[None, :]).ravel(), n * m / 2.0 - slack)
    return Test(RANK_SUM, n + m, u, (), p, location, "r", _biserial(x, y))


def several_ranked(groups: Sequence[Floats]) -> Test:
    values = tied(np.concatenate(groups))
    n, df = len(values), len(groups) - 1.0
    if (values == values[0]).all():
        return Test(KRUSKAL, n, remark=NO_VARIANCE)
    ends = np.cumsum([len(group) for group in groups])
    h, p = map(float, scipy.stats.kruskal(*np.split(values, ends[:-1])))
    effect = IntervalEstimate(h / (n - 1.0))
    return Test(KRUSKAL, n, h, (df,), p, effect_name="ε²", effect=effect)


def several_ranked_within(table: Floats, name: str = FRIEDMAN) -> Test:
    """Compare three or more conditions, (n, k); of zeros and ones, this is Cochran's Q (1950)."""
    n, k = table.shape
    if n < 2:
        return Test(name, n, remark=TOO_FEW)
    values = tied(table)
    if (values == values[:, :1]).all():
        return Test(name, n, remark=NO_VARIANCE)
    chi2, p = map(float, scipy.stats.friedmanchisquare(*values.T))
    effect = IntervalEstimate(chi2 / (n * (k - 1)))
    return Test(name, n, chi2, (k - 1.0,), p, effect_name="W (Kendall)", effect=effect)


def signed_rank_p(differences: Floats) -> Floats:
    found = scipy.stats.wilcoxon(differences, zero_method="pratt", axis=-1)
    return np.asarray(found.pvalue)


def _median(values: Floats, below: float) -> IntervalEstimate:
    """Return the median, and the order statistics that have `below` values outside of them."""
    ordered = np.sort(values)
    place = max(0, math.floor(below))
    low, high = float(ordered[place]), float(ordered[len(ordered) - 1 - place])
    return IntervalEstimate(float(np.median(ordered)), low, high)


def _biserial(first: Floats, second: Floats) -> IntervalEstimate:
    """Return r with its interval: how much more often the first group has the greater value."""
    signs = np.sign(first[:, None] - second[None, :])
    size = float(signs.mean())
    rows, columns = signs.mean(axis=1), signs.mean(axis=0)
    variance = rows.var(ddof=1) / len(rows) + columns.var(ddof=1) / len(columns)
    # by the delta method, the standard error of Fisher's z is that of r over 1 - r²
    return by_fisher(size, math.sqrt(float(variance)) / max(1.0 - size**2, 1e-12))
