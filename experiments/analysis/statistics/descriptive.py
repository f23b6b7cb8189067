"""Numbers that describe and compare samples; a participant, never a session, is the unit of a test.

- Quantiles are the linear ones of Hyndman and Fan (1996, type 7), numpy's and R's default.
- Two conditions: Welch's t test between participants (Welch, 1947), the paired t test within them;
  Cohen's d with the pooled standard deviation, d_z within. More than two: Welch's analysis of
  variance (Welch, 1951) between, Friedman's test within.
- A relation: Spearman's rank correlation, with the t approximation of its p value.
- Several tests of one question: Holm (1979).

Tests take arrays with any leading axes, so that a thousand simulated studies are one call.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.special import fdtrc, ndtri, stdtr

from experiments.analysis.dataset.records import Floats


@dataclass(frozen=True)
class Spread:
    """A sample in a few numbers; all but `n` are None when it is empty, `sd` below two values."""

    n: int
    mean: float | None = None
    sd: float | None = None
    p5: float | None = None
    median: float | None = None
    p95: float | None = None


def spread(values: Sequence[float] | Floats) -> Spread:
    """Return a sample in a few numbers; NaN does not count."""
    given = np.asarray(values, dtype=np.float64)
    given = given[np.isfinite(given)]
    if not given.size:
        return Spread(0)
    low, middle, high = np.percentile(given, (5, 50, 95)).tolist()
    sd = float(given.std(ddof=1)) if given.size > 1 else None
    return Spread(given.size, float(given.mean()), sd, low, middle, high)


def shares(counts: Sequence[int], decimals: int = 1) -> tuple[float, ...] | None:
    """Return counts as percentages that sum to exactly 100 as printed; None when nothing was
    counted.

    The largest remainders are rounded up (Hamilton's method), ties from the left.
    """
    total = sum(counts)
    if not total:
        return None
    units = 100 * 10**decimals
    whole = [count * units // total for count in counts]
    order = sorted(range(len(counts)), key=lambda index: (-(counts[index] * units % total), index))
    for index in order[: units - sum(whole)]:
        whole[index] += 1
    return tuple(unit / 10**decimals for unit in whole)


@dataclass(frozen=True)
class Test:
    """A test of one hypothesis: number of participants, statistic, two-sided p, and size of the
    effect; NaN where there are too few.
    """

    name: str
    n: int
    statistic: float
    p: float
    effect: float
    difference: float = math.nan


def welch(first: Floats, second: Floats) -> tuple[Floats, Floats]:
    """Return t and two-sided p of the difference of two groups' means, along the last axis; NaN
    with fewer than two in one.
    """
    n, m = first.shape[-1], second.shape[-1]
    if min(n, m) < 2:
        nothing = np.full(np.broadcast_shapes(first.shape[:-1], second.shape[:-1]), np.nan)
        return nothing, nothing
    a, b = first.var(axis=-1, ddof=1) / n, second.var(axis=-1, ddof=1) / m
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (first.mean(axis=-1) - second.mean(axis=-1)) / np.sqrt(a + b)
        freedom = (a + b) ** 2 / (a**2 / (n - 1) + b**2 / (m - 1))
    return t, 2.0 * stdtr(freedom, -np.abs(t))


def paired(first: Floats, second: Floats) -> tuple[Floats, Floats]:
    """Return t and two-sided p of the mean difference of pairs, along the last axis; NaN with fewer
    than two.
    """
    differences = first - second
    n = differences.shape[-1]
    if n < 2:
        return np.full(differences.shape[:-1], np.nan), np.full(differences.shape[:-1], np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = differences.mean(axis=-1) / (differences.std(axis=-1, ddof=1) / math.sqrt(n))
    return t, 2.0 * stdtr(n - 1, -np.abs(t))


def between(first: Floats, second: Floats) -> Test:
    """Compare two groups of participants; the effect is Cohen's d."""
    t, p = welch(first, second)
    n, m = len(first), len(second)
    if min(n, m) < 2:
        return Test("Welch t", n + m, math.nan, math.nan, math.nan)
    pooled = math.sqrt(((n - 1) * first.var(ddof=1) + (m - 1) * second.var(ddof=1)) / (n + m - 2))
    difference = float(first.mean() - second.mean())
    return Test(
        "Welch t",
        n + m,
        float(t),
        float(p),
        difference / pooled if pooled else math.nan,
        difference,
    )


def within(first: Floats, second: Floats) -> Test:
    """Compare two conditions that the same participants had; the effect is d_z."""
    t, p = paired(first, second)
    differences = first - second
    sd = float(differences.std(ddof=1)) if len(differences) > 1 else 0.0
    mean = float(differences.mean()) if len(differences) else math.nan
    return Test(
        "paired t", len(differences), float(t), float(p), mean / sd if sd else math.nan, mean
    )


def several_between(groups: Sequence[Floats]) -> Test:
    """Compare three or more groups of participants (Welch's F); the effect is eta squared."""
    total = sum(len(group) for group in groups)
    if min(len(group) for group in groups) < 2:
        return Test("Welch F", total, math.nan, math.nan, math.nan)
    k = len(groups)
    means = np.array([group.mean() for group in groups])
    sizes = np.array([len(group) for group in groups], dtype=np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        weights = sizes / np.array([group.var(ddof=1) for group in groups])
        centre = (weights * means).sum() / weights.sum()
        slack = ((1.0 - weights / weights.sum()) ** 2 / (sizes - 1)).sum()
        f = (
            (weights * (means - centre) ** 2).sum()
            / (k - 1)
            / (1.0 + 2.0 * (k - 2) / (k * k - 1) * slack)
        )
        p = float(fdtrc(k - 1, (k * k - 1) / (3.0 * slack), f))
    values = np.concatenate(groups)
    around = ((values - values.mean()) ** 2).sum()
    return Test(
        "Welch F",
        total,
        float(f),
        p,
        float((sizes * (means - values.mean()) ** 2).sum() / around) if around else math.nan,
    )


def several_within(table: Floats) -> Test:
    """Compare three or more conditions that the same participants had, (n, k); the effect is
    Kendall's W.
    """
    n, k = table.shape
    if n < 2 or (table == table[:, :1]).all():
        return Test("Friedman chi2", n, math.nan, math.nan, math.nan)
    found = stats.friedmanchisquare(*table.T)
    return Test(
        "Friedman chi2",
        n,
        float(found.statistic),
        float(found.pvalue),
        float(found.statistic) / (n * (k - 1)),
    )


def correlation(first: Floats, second: Floats) -> Test:
    """Return Spearman's rank correlation of pairs; pairs with a NaN do not count, fewer than four
    or one equal value give NaN.
    """
    given = np.isfinite(first) & np.isfinite(second)
    x, y = first[given], second[given]
    if len(x) < 4 or (x == x[0]).all() or (y == y[0]).all():
        return Test("Spearman rho", len(x), math.nan, math.nan, math.nan)
    found = stats.spearmanr(x, y)
    return Test(
        "Spearman rho", len(x), float(found.statistic), float(found.pvalue), float(found.statistic)
    )


def holm(values: Sequence[float]) -> tuple[float, ...]:
    """Return p values that were corrected for being several; NaN stays, and does not count."""
    given = sorted((p, index) for index, p in enumerate(values) if math.isfinite(p))
    corrected, greatest = list(values), 0.0
    for rank, (p, index) in enumerate(given):
        greatest = max(greatest, min(1.0, p * (len(given) - rank)))
        corrected[index] = greatest
    return tuple(corrected)


def wilson(successes: int, n: int, level: float = 0.95) -> tuple[float, float] | None:
    """Return the bounds of a share (Wilson, 1927), or None without trials."""
    if not n:
        return None
    z = float(ndtri(0.5 + level / 2.0))
    centre, slack = (
        (successes + z * z / 2.0) / (n + z * z),
        z * math.sqrt(successes * (n - successes) / n + z * z / 4.0) / (n + z * z),
    )
    return max(0.0, centre - slack), min(1.0, centre + slack)
