"""Tests that compare samples, each with everything that is printed of it; a participant, never a
session, is the unit.

- Two conditions: Welch's t test between participants (Welch, 1947), the paired t test within them.
  The effect is Cohen's d with the pooled standard deviation, or d_z; its interval inverts the
  noncentral t distribution (Steiger and Fouladi, 1997), for d with the t of the pooled variance.
- More than two: Welch's analysis of variance (Welch, 1951) between, with η²p of the ordinary one,
  whose interval inverts the noncentral F distribution (Steiger, 2004); Friedman's test within, with
  Kendall's W, whose interval comes from resampling participants.
- A relation: Spearman's rank correlation with the t approximation of its p value, and the interval
  of Bonett and Wright (2000).
- Several tests of one question: Holm (1979), each member of the family once.

All intervals are of 95 %. A sample without variance is said in words: a difference of its size in
rounding would otherwise be divided by, and give a t of 1e16.

`welch`, `paired`, `welch_f` and `friedman` take arrays with any leading axes, so that a thousand
simulated studies are one call; so do `holm_rows`, and the p values of rank_tests.py.
"""

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from experiments.analysis.dataset.records import Floats

LEVEL = 0.95
LOWER, UPPER = (1.0 - LEVEL) / 2.0, (1.0 + LEVEL) / 2.0
ROUNDING = 1e-9  # relative; differences below it come from rounding alone
RESAMPLES, SEED = 2000, 1939  # of participants, for the interval of Kendall's W
DIGITS = 12  # that two values share which are a tie
NO_VARIANCE = "no variance"
EQUAL_DIFFERENCES = "no variance: all differences are equal"
TOO_FEW = "fewer than two participants"


@dataclass(frozen=True)
class IntervalEstimate:
    """A number and its 95 % confidence interval; NaN where it is unknown."""

    value: float = math.nan
    low: float = math.nan
    high: float = math.nan


UNKNOWN = IntervalEstimate()


@dataclass(frozen=True)
class Test:
    """A test of one hypothesis.

    Attributes:
        name: what it is called; "–" where there was none.
        n: participants that were tested; pairs, for a paired test.
        statistic: its value; NaN where there was no test, and then `remark` says why.
        df: degrees of freedom, none to two.
        p: two-sided.
        difference: of the two means (or of the locations, for a test of ranks), first less second.
        effect_name: what the size of the effect is called.
        effect: the size.
        remark: what was left out of the test and why, parts divided by "; ".
    """

    name: str
    n: int
    statistic: float = math.nan
    df: tuple[float, ...] = ()
    p: float = math.nan
    difference: IntervalEstimate = UNKNOWN
    effect_name: str = ""
    effect: IntervalEstimate = UNKNOWN
    remark: str = ""

    @property
    def is_known(self) -> bool:
        """Tell whether there was anything to test."""
        return math.isfinite(self.p)


def is_constant(values: Floats, scale: float = 0.0) -> bool:
    """Tell whether values differ by no more than rounding, of themselves or of numbers as large as
    `scale`.
    """
    largest = max(scale, float(np.abs(values).max(initial=0.0)))
    return bool(np.ptp(values) <= ROUNDING * largest) if len(values) else True


def tied(values: Floats) -> Floats:
    """Return values for ranking: those that differ by rounding alone are equal."""
    with np.errstate(divide="ignore"):
        power = np.where(values == 0.0, 0.0, np.floor(np.log10(np.abs(values))))
    unit = 10.0 ** (DIGITS - 1.0 - power)
    rounded: Floats = np.round(values * unit) / unit
    return rounded


# --- two samples ----------------------------------------------------------------------------------


def welch(first: Floats, second: Floats) -> tuple[Floats, Floats]:
    """Return t and two-sided p of the difference of two groups' means, along the last axis; NaN
    with fewer than two in one, or without any variance.
    """
    n, m = first.shape[-1], second.shape[-1]
    if min(n, m) < 2:
        nothing = np.full(np.broadcast_shapes(first.shape[:-1], second.shape[:-1]), np.nan)
        return nothing, nothing
    a, b = first.var(axis=-1, ddof=1) / n, second.var(axis=-1, ddof=1) / m
    with np.errstate(divide="ignore", invalid="ignore"):
        error = np.where(a + b > 0.0, np.sqrt(a + b), np.nan)
        t = (first.mean(axis=-1) - second.mean(axis=-1)) / error
        freedom = (a + b) ** 2 / (a**2 / (n - 1) + b**2 / (m - 1))
    return t, 2.0 * scipy.special.stdtr(freedom, -np.abs(t))


def paired(first: Floats, second: Floats) -> tuple[Floats, Floats]:
    """Return t and two-sided p of the mean difference of pairs, along the last axis; NaN with fewer
    than two, or without any variance.
    """
    differences = first - second
    n = differences.shape[-1]
    if n < 2:
        return np.full(differences.shape[:-1], np.nan), np.full(differences.shape[:-1], np.nan)
    sd = differences.std(axis=-1, ddof=1)
    t = differences.mean(axis=-1) / (np.where(sd > 0.0, sd, np.nan) / math.sqrt(n))
    return t, 2.0 * scipy.special.stdtr(n - 1, -np.abs(t))


def between(first: Floats, second: Floats) -> Test:
    """Compare two groups of participants; the effect is Cohen's d."""
    n, m = len(first), len(second)
    if min(n, m) < 2:
        return Test("Welch t", n + m, remark=TOO_FEW)
    difference = float(first.mean() - second.mean())
    scale = float(np.abs(np.concatenate((first, second))).max())
    if is_constant(first, scale) and is_constant(second, scale):
        return Test("Welch t", n + m, difference=IntervalEstimate(difference), remark=NO_VARIANCE)
    a, b = float(first.var(ddof=1)) / n, float(second.var(ddof=1)) / m
    error = math.sqrt(a + b)
    freedom = (a + b) ** 2 / (a**2 / (n - 1) + b**2 / (m - 1))
    pooled = math.sqrt(((n - 1) * n * a + (m - 1) * m * b) / (n + m - 2))
    t = difference / error
    return Test(
        "Welch t",
        n + m,
        t,
        (freedom,),
        float(2.0 * scipy.special.stdtr(freedom, -abs(t))),
        _around(difference, error, freedom),
        "d",
        standardized(difference / pooled, n * m / (n + m), n + m - 2),
    )


def within(first: Floats, second: Floats) -> Test:
    """Compare two conditions that the same participants had; the effect is d_z."""
    n = len(first)
    if n < 2:
        return Test("paired t", n, remark=TOO_FEW)
    differences = first - second
    mean = float(differences.mean())
    scale = float(np.abs(np.concatenate((first, second))).max())
    if is_constant(differences, scale):
        return Test("paired t", n, difference=IntervalEstimate(mean), remark=EQUAL_DIFFERENCES)
    sd = float(differences.std(ddof=1))
    t = mean / (sd / math.sqrt(n))
    return Test(
        "paired t",
        n,
        t,
        (float(n - 1),),
        float(2.0 * scipy.special.stdtr(n - 1, -abs(t))),
        _around(mean, sd / math.sqrt(n), n - 1),
        "d_z",
        standardized(mean / sd, n, n - 1),
    )


def _around(value: float, error: float, freedom: float) -> IntervalEstimate:
    slack = float(scipy.special.stdtrit(freedom, UPPER)) * error
    return IntervalEstimate(value, value - slack, value + slack)


def standardized(size: float, weight: float, freedom: float) -> IntervalEstimate:
    """Return a standardized difference with its interval: t = size·√weight has a noncentral t
    distribution, and the bounds are the noncentralities that put it at 2.5 and 97.5 %.
    """
    root = math.sqrt(weight)
    low, high = (
        float(scipy.special.nctdtrinc(freedom, tail, size * root)) / root for tail in (UPPER, LOWER)
    )
    return IntervalEstimate(size, low, high)


# --- several samples ------------------------------------------------------------------------------


def several_between(groups: Sequence[Floats]) -> Test:
    """Compare three or more groups of participants, each with variance (Welch's F); the effect is
    η²p, which is η² because there is one factor.
    """
    total = sum(len(group) for group in groups)
    if min(len(group) for group in groups) < 2:
        return Test("Welch F", total, remark=TOO_FEW)
    if any(is_constant(group) for group in groups):
        return Test("Welch F", total, remark=NO_VARIANCE)
    f, inner, p = (float(one) for one in welch_f(groups))
    return Test(
        "Welch F",
        total,
        f,
        (len(groups) - 1.0, inner),
        p,
        effect_name="η²p",
        effect=_eta_squared(groups),
    )


def welch_f(groups: Sequence[Floats]) -> tuple[Floats, Floats, Floats]:
    """Return Welch's F of groups, (…, n) each, along the last axis, with the degrees of freedom of
    its denominator and its p value.
    """
    k = len(groups)
    means = np.stack([group.mean(axis=-1) for group in groups], axis=-1)
    sizes = np.array([group.shape[-1] for group in groups], dtype=np.float64)
    weights = sizes / np.stack([group.var(axis=-1, ddof=1) for group in groups], axis=-1)
    total = weights.sum(axis=-1, keepdims=True)
    centre = (weights * means).sum(axis=-1, keepdims=True) / total
    slack = ((1.0 - weights / total) ** 2 / (sizes - 1)).sum(axis=-1)
    spread = (weights * (means - centre) ** 2).sum(axis=-1) / (k - 1)
    f = spread / (1.0 + 2.0 * (k - 2) / (k * k - 1) * slack)
    inner = (k * k - 1) / (3.0 * slack)
    return f, inner, np.asarray(scipy.special.fdtrc(k - 1.0, inner, f))


def _eta_squared(groups: Sequence[Floats]) -> IntervalEstimate:
    values = np.concatenate(groups)
    total = float(((values - values.mean()) ** 2).sum())
    inside = math.fsum(float(((group - group.mean()) ** 2).sum()) for group in groups)
    size = 1.0 - inside / total
    n, k = len(values), len(groups)
    f = size / (1.0 - size) * (n - k) / (k - 1)
    bounds = (float(scipy.special.ncfdtrinc(k - 1, n - k, tail, f)) for tail in (UPPER, LOWER))
    low, high = (bound / (bound + n) for bound in bounds)
    return IntervalEstimate(size, low, high)


def several_within(table: Floats) -> Test:
    """Compare three or more conditions that the same participants had, (n, k), by their ranks; the
    effect is Kendall's W.
    """
    n, k = table.shape
    name = "Friedman χ²"
    if n < 2:
        return Test(name, n, remark=TOO_FEW)
    values = tied(table)
    if (values == values[:, :1]).all():
        return Test(name, n, remark=NO_VARIANCE)
    chi2, p = (float(one) for one in friedman(values))
    return Test(
        name,
        n,
        chi2,
        (k - 1.0,),
        p,
        effect_name="W (Kendall)",
        effect=_concordance(chi2 / (n * (k - 1)), values),
    )


def friedman(table: Floats) -> tuple[Floats, Floats]:
    """Return Friedman's χ² and its p value of conditions that the same participants had, (…, n, k);
    NaN where no participant has two different values.
    """
    n, k = table.shape[-2:]
    ranks = scipy.stats.rankdata(table, axis=-1)
    sums = ranks.sum(axis=-2)
    # the ranks' variance is less with ties: Conover, Practical Nonparametric Statistics, 5.8
    spread = (ranks**2).sum(axis=(-1, -2)) - n * k * (k + 1.0) ** 2 / 4.0
    with np.errstate(divide="ignore", invalid="ignore"):
        chi2 = (k - 1.0) * ((sums - n * (k + 1.0) / 2.0) ** 2).sum(axis=-1) / spread
    return chi2, np.asarray(scipy.special.chdtrc(k - 1.0, chi2))


def _concordance(size: float, table: Floats) -> IntervalEstimate:
    """Return W with the 2.5 and 97.5 % quantiles of the W of resampled participants."""
    n, k = table.shape
    ranks = scipy.stats.rankdata(table, axis=1)
    ties = np.array([_tie_term(row) for row in ranks])
    drawn = np.random.default_rng(SEED).multinomial(n, np.full(n, 1.0 / n), RESAMPLES)
    sums = drawn @ ranks
    whole = n * k * (k * k - 1.0)
    loss = 1.0 - drawn @ ties / whole
    with np.errstate(divide="ignore", invalid="ignore"):
        chi2 = (12.0 / (n * k * (k + 1.0)) * (sums**2).sum(axis=1) - 3.0 * n * (k + 1.0)) / loss
    found = chi2[np.isfinite(chi2)] / (n * (k - 1))
    low, high = np.clip(np.quantile(found, (LOWER, UPPER)), 0.0, 1.0).tolist()
    return IntervalEstimate(size, low, high)


def _tie_term(ranks: Floats) -> float:
    _, counts = np.unique(ranks, return_counts=True)
    return float((counts.astype(np.float64) ** 3 - counts).sum())


# --- relations, and several tests -----------------------------------------------------------------


def correlation(first: Floats, second: Floats) -> Test:
    """Return Spearman's rank correlation of pairs; pairs with a NaN do not count, fewer than four
    or one equal value give none.
    """
    given = np.isfinite(first) & np.isfinite(second)
    x, y = tied(first[given]), tied(second[given])
    n = len(x)
    if n < 4:
        return Test("Spearman ρ", n, remark="fewer than four participants")
    if (x == x[0]).all() or (y == y[0]).all():
        return Test("Spearman ρ", n, remark=NO_VARIANCE)
    found = scipy.stats.spearmanr(x, y)
    rho = float(found.statistic)
    return Test(
        "Spearman ρ",
        n,
        rho,
        (n - 2.0,),
        float(found.pvalue),
        effect_name="ρ",
        effect=_correlated(rho, n),
    )


def _correlated(rho: float, n: int) -> IntervalEstimate:
    if abs(rho) >= 1.0:
        return IntervalEstimate(rho)
    slack = float(scipy.special.ndtri(UPPER)) * math.sqrt((1.0 + rho * rho / 2.0) / (n - 3))
    centre = math.atanh(rho)
    return IntervalEstimate(rho, math.tanh(centre - slack), math.tanh(centre + slack))


def holm(values: Sequence[float], members: Sequence[Hashable] | None = None) -> tuple[float, ...]:
    """Return p values that were corrected for being several; NaN stays, and does not count.

    Args:
        values: the p values.
        members: what each tested. Those with equal ones are one member of the family: the same test
            under two names is corrected for once, and keeps one p value.
    """
    named = range(len(values)) if members is None else members
    distinct = {member: p for member, p in zip(named, values, strict=True) if math.isfinite(p)}
    corrected, greatest = {}, 0.0
    for rank, (member, p) in enumerate(sorted(distinct.items(), key=lambda one: one[1])):
        greatest = max(greatest, min(1.0, p * (len(distinct) - rank)))
        corrected[member] = greatest
    return tuple(corrected.get(member, math.nan) for member in named)


def holm_rows(values: Floats) -> Floats:
    """Return p values, (…, tests), corrected by Holm's method along the last axis."""
    count = values.shape[-1]
    order = np.argsort(values, axis=-1)
    ordered = np.take_along_axis(values, order, axis=-1) * np.arange(count, 0, -1)
    corrected = np.minimum(np.maximum.accumulate(ordered, axis=-1), 1.0)
    found = np.empty_like(values)
    np.put_along_axis(found, order, corrected, axis=-1)
    return found
