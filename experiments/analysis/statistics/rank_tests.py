"""Tests of ranks, for ordinal answers and for values that no normal distribution describes.

- Pairs: Wilcoxon's signed ranks (1945); pairs without a difference do not count. The difference is
  the median of the Walsh averages (Hodges and Lehmann, 1963), the effect the matched-pairs
  rank-biserial correlation r (Kerby, 2014).
- Two groups: Mann and Whitney (1947), with the median of all differences and the rank-biserial r.
- Several groups: Kruskal and Wallis (1952), with ε² = H / (n - 1) (Tomczak and Tomczak, 2014),
  whose interval comes from resampling participants within their groups. Several conditions of the
  same participants are compared by Friedman's test (comparisons.several_within).

p values are exact up to 50 pairs, or 8 participants in a group, without ties, and up to 13 pairs
with them; otherwise normal approximations corrected for ties. The interval of r is that of Fisher's
z with the standard error of the rank sum. Intervals of a difference are the order statistics of the
averages or differences.
"""

import math
from collections.abc import Sequence

import numpy as np
import scipy

from experiments.analysis.dataset.records import Floats
from experiments.analysis.statistics.comparisons import (
    EQUAL_DIFFERENCES,
    LOWER,
    NO_VARIANCE,
    RESAMPLES,
    SEED,
    TOO_FEW,
    UPPER,
    IntervalEstimate,
    Test,
    tied,
)

EXACT_WITH_TIES = 13  # pairs
SIGNED, RANK_SUM, KRUSKAL = "Wilcoxon signed rank", "Mann-Whitney U", "Kruskal-Wallis H"


def signed_ranks(first: Floats, second: Floats) -> Test:
    """Compare two conditions that the same participants had; the statistic is the sum of the
    positive ranks.
    """
    n = len(first)
    if n < 2:
        return Test(SIGNED, n, remark=TOO_FEW)
    differences = tied(first - second)
    # a difference that is rounding alone is none
    scale = float(np.abs(np.concatenate((first, second))).max(initial=0.0))
    differences = np.where(np.abs(differences) <= 1e-12 * scale, 0.0, differences)
    moved = differences[differences != 0.0]
    if not len(moved):
        return Test(SIGNED, n, difference=IntervalEstimate(0.0), remark=EQUAL_DIFFERENCES)
    ranks = scipy.stats.rankdata(np.abs(moved))
    positive = float(ranks[moved > 0.0].sum())
    count = len(moved)
    largest = count * (count + 1) / 2.0
    error = math.sqrt((2.0 * count**3 + 3.0 * count**2 + count) / 6.0) / largest
    walsh = (differences[:, None] + differences[None, :])[np.triu_indices(n)] / 2.0
    slack = float(scipy.special.ndtri(UPPER)) * math.sqrt(n * (n + 1.0) * (2.0 * n + 1.0) / 24.0)
    return Test(
        SIGNED,
        n,
        positive,
        (),
        _signed_rank_p(moved, ranks),
        _median(walsh, n * (n + 1.0) / 4.0 - slack),
        "r",
        _biserial(2.0 * positive / largest - 1.0, error),
        _left_out(n - count),
    )


def _left_out(pairs: int) -> str:
    if not pairs:
        return ""
    said = (
        "1 pair without a difference does"
        if pairs == 1
        else f"{pairs} pairs without a difference do"
    )
    return f"{said} not count"


def _signed_rank_p(moved: Floats, ranks: Floats) -> float:
    """Return the p of differences (n,), none of them 0, with ranks (n,) of their sizes."""
    n = len(ranks)
    if n > EXACT_WITH_TIES or len(np.unique(ranks)) == n:
        return float(signed_rank_p(moved))
    # each difference might as well have had the other sign: all 2ⁿ sums of positive ranks
    signs = np.arange(2**n)[:, None] >> np.arange(n) & 1
    sums = signs @ ranks
    positive = float(ranks[moved > 0.0].sum())
    return min(1.0, 2.0 * min(float((sums <= positive).mean()), float((sums >= positive).mean())))


def rank_sums(first: Floats, second: Floats) -> Test:
    """Compare two groups of participants; the statistic is the U of the first."""
    n, m = len(first), len(second)
    if min(n, m) < 2:
        return Test(RANK_SUM, n + m, remark=TOO_FEW)
    x, y = np.split(tied(np.concatenate((first, second))), [n])
    if (np.concatenate((x, y)) == x[0]).all():
        return Test(RANK_SUM, n + m, difference=IntervalEstimate(0.0), remark=NO_VARIANCE)
    u, p = (float(one) for one in rank_sum_u(x, y))
    error = math.sqrt((n + m + 1.0) / (3.0 * n * m))
    slack = float(scipy.special.ndtri(UPPER)) * math.sqrt(n * m * (n + m + 1.0) / 12.0)
    return Test(
        RANK_SUM,
        n + m,
        u,
        (),
        p,
        _median((x[:, None] - y[None, :]).ravel(), n * m / 2.0 - slack),
        "r",
        _biserial(2.0 * u / (n * m) - 1.0, error),
    )


def several_ranked(groups: Sequence[Floats]) -> Test:
    """Compare three or more groups of participants; the effect is ε²."""
    sizes = [len(group) for group in groups]
    n = sum(sizes)
    if min(sizes) < 2:
        return Test(KRUSKAL, n, remark=TOO_FEW)
    values = tied(np.concatenate(groups))
    if (values == values[0]).all():
        return Test(KRUSKAL, n, remark=NO_VARIANCE)
    parts = np.split(values, np.cumsum(sizes)[:-1])
    h, p = (float(one) for one in kruskal(parts))
    rng = np.random.default_rng(SEED)
    drawn = np.concatenate([rng.choice(one, (RESAMPLES, len(one))) for one in parts], axis=1)
    resampled = _h(scipy.stats.rankdata(drawn, axis=1), sizes) / (n - 1.0)
    low, high = np.quantile(resampled[np.isfinite(resampled)], (LOWER, UPPER)).tolist()
    return Test(
        KRUSKAL,
        n,
        h,
        (len(groups) - 1.0,),
        p,
        effect_name="ε²",
        effect=IntervalEstimate(h / (n - 1.0), low, high),
    )


def signed_rank_p(differences: Floats) -> Floats:
    """Return the p values of Wilcoxon's test of differences, (…, n), none of which is 0."""
    return np.asarray(
        scipy.stats.wilcoxon(differences, correction=False, method="auto", axis=-1).pvalue
    )


def rank_sum_u(first: Floats, second: Floats) -> tuple[Floats, Floats]:
    """Return Mann and Whitney's U of the first group and its p value, along the last axis."""
    found = scipy.stats.mannwhitneyu(
        first, second, alternative="two-sided", use_continuity=False, axis=-1
    )
    return np.asarray(found.statistic), np.asarray(found.pvalue)


def kruskal(groups: Sequence[Floats]) -> tuple[Floats, Floats]:
    """Return Kruskal and Wallis's H of groups and its p value, along the last axis."""
    sizes = [group.shape[-1] for group in groups]
    ranks = scipy.stats.rankdata(np.concatenate(groups, axis=-1), axis=-1)
    h = _h(np.atleast_2d(ranks), sizes).reshape(ranks.shape[:-1])
    return h, np.asarray(scipy.special.chdtrc(len(groups) - 1.0, h))


def _h(ranks: Floats, sizes: Sequence[int]) -> Floats:
    """Return the H of rows of ranks, (m, n), whose columns are groups of some sizes; as the share
    of the ranks' variance, which corrects for ties.
    """
    n = ranks.shape[1]
    middle = (n + 1.0) / 2.0
    ends = np.cumsum(sizes)
    between = sum(
        size * (ranks[:, end - size : end].mean(axis=1) - middle) ** 2
        for size, end in zip(sizes, ends, strict=True)
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        found: Floats = (n - 1.0) * between / ((ranks - middle) ** 2).sum(axis=1)
    return found


def _median(values: Floats, below: float) -> IntervalEstimate:
    """Return the median of averages or differences, and the order statistics with so many below."""
    ordered = np.sort(values)
    place = max(0, math.floor(below))
    return IntervalEstimate(
        float(np.median(ordered)), float(ordered[place]), float(ordered[len(ordered) - 1 - place])
    )


def _biserial(size: float, error: float) -> IntervalEstimate:
    if abs(size) >= 1.0:
        return IntervalEstimate(size)
    centre, slack = math.atanh(size), float(scipy.special.ndtri(UPPER)) * error
    return IntervalEstimate(size, math.tanh(centre - slack), math.tanh(centre + slack))
