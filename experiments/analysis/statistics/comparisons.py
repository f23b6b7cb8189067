"""Tests of means and of relations, each with its effect size; a participant, never a session, is
the unit. docs/explanation/statistics.md has the sources, and how often each is wrong.

The effect of two conditions is d, the difference over the root of the mean of both variances, with
an interval that lets variances differ as Welch's test does (Bonett, 2008), or d_z within
participants. That of more conditions is η²p, without an interval: the known ones assume equal
variances. All intervals are of 95 %. A sample without variance has a remark and no test: a division
by what rounding leaves of it would give a t of 1e16.
"""

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from experiments.dataset.columns import Floats

LEVEL = 0.95
LOWER, UPPER = (1.0 - LEVEL) / 2.0, (1.0 + LEVEL) / 2.0
Z = float(scipy.special.ndtri(UPPER))
ROUNDING = 1e-9  # relative; differences below it come from rounding alone
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
    name: str  # "–" without a test
    n: int  # participants tested; pairs, for a paired test
    statistic: float = math.nan  # NaN without a test; `remark` then gives the reason
    df: tuple[float, ...] = ()  # none to two
    p: float = math.nan  # two-sided
    difference: IntervalEstimate = UNKNOWN  # of means, locations or shares, first less second
    effect_name: str = ""
    effect: IntervalEstimate = UNKNOWN
    remark: str = ""  # what was left out of the test and why, parts divided by "; "

    @property
    def is_known(self) -> bool:
        return math.isfinite(self.p)


def is_constant(values: Floats, scale: float = 0.0) -> bool:
    """Tell whether values differ by rounding alone: theirs, or that of numbers of size `scale`."""
    largest = max(scale, float(np.abs(values).max(initial=0.0)))
    return bool(np.ptp(values) <= ROUNDING * largest) if len(values) else True


def tied(values: Floats) -> Floats:
    """Return values for ranking: those that differ by rounding alone are equal."""
    with np.errstate(divide="ignore"):
        power = np.where(values == 0.0, 0.0, np.floor(np.log10(np.abs(values))))
    unit = 10.0 ** (DIGITS - 1.0 - power)
    return np.asarray(np.round(values * unit) / unit)


# --- two samples ----------------------------------------------------------------------------------


def between(first: Floats, second: Floats) -> Test:
    """Compare two groups, each with variance."""
    n = len(first) + len(second)
    difference = float(first.mean() - second.mean())
    found = scipy.stats.ttest_ind(first, second, equal_var=False)
    return Test("Welch t", n, *_of_t(found, difference), "d", _standardized(first, second))


def within(first: Floats, second: Floats) -> Test:
    n = len(first)
    if n < 2:
        return Test("paired t", n, remark=TOO_FEW)
    differences = first - second
    mean = float(differences.mean())
    scale = float(np.abs(np.concatenate((first, second))).max())
    if is_constant(differences, scale):
        return Test("paired t", n, difference=IntervalEstimate(mean), remark=EQUAL_DIFFERENCES)
    found = scipy.stats.ttest_1samp(differences, 0.0)
    return Test("paired t", n, *_of_t(found, mean), "d_z", standardized(found.statistic, n))


def _of_t(
    found: "scipy.stats._stats_py.TtestResult", difference: float
) -> tuple[float, tuple[float, ...], float, IntervalEstimate]:
    bounds = found.confidence_interval(LEVEL)
    estimate = IntervalEstimate(difference, float(bounds.low), float(bounds.high))
    return float(found.statistic), (float(found.df),), float(found.pvalue), estimate


def standardized(t: float, n: int) -> IntervalEstimate:
    """Return d_z with its interval: t = d_z·√n has a noncentral t distribution, and the bounds are
    the noncentralities that put it at 2.5 and 97.5 %.
    """
    bounds = [float(scipy.special.nctdtrinc(n - 1, tail, t)) for tail in (UPPER, LOWER)]
    return IntervalEstimate(*(one / math.sqrt(n) for one in (float(t), *bounds)))


def _standardized(first: Floats, second: Floats) -> IntervalEstimate:
    """Return d of two groups whose variances may differ (Bonett, 2008, equation 12)."""
    variances = np.array([first.var(ddof=1), second.var(ddof=1)])
    df = np.array([len(first) - 1.0, len(second) - 1.0])
    whole = float(variances.mean())
    d = float(first.mean() - second.mean()) / math.sqrt(whole)
    of_sd = d * d * (variances**2 / df).sum() / (8.0 * whole**2)
    slack = Z * math.sqrt(float(of_sd + (variances / df).sum() / whole))
    return IntervalEstimate(d, d - slack, d + slack)


# --- several samples ------------------------------------------------------------------------------


def several_between(groups: Sequence[Floats]) -> Test:
    """Compare three or more groups, each with variance (Welch's F); η²p is η² with one factor."""
    from statsmodels.stats.oneway import anova_oneway  # noqa: PLC0415 - not on robots

    found = anova_oneway(groups, use_var="unequal")
    values = np.concatenate(groups)
    within_groups = math.fsum(len(group) * float(group.var()) for group in groups)
    effect = IntervalEstimate(1.0 - within_groups / (len(values) * float(values.var())))
    f, p, *df = map(float, (found.statistic, found.pvalue, found.df_num, found.df_denom))
    return Test("Welch F", len(values), f, tuple(df), p, effect_name="η²p", effect=effect)


def several_within(table: Floats) -> Test:
    n = len(table)
    name = "repeated-measures F"
    if n < 2:
        return Test(name, n, remark=TOO_FEW)
    spreads = table - table[:, :1]
    if all(is_constant(one, float(np.abs(table).max())) for one in spreads.T):
        return Test(name, n, remark=EQUAL_DIFFERENCES)
    f, df, p = map(float, repeated_measures(table))
    effect = IntervalEstimate(f / (f + n - 1.0))
    return Test(name, n, f, (df, df * (n - 1.0)), p, effect_name="η²p", effect=effect)


def repeated_measures(table: Floats) -> tuple[Floats, Floats, Floats]:
    """Return F of the analysis of variance for repeated measures, (…, n, k), its numerator's
    degrees of freedom (Greenhouse and Geisser; the denominator has n - 1 times as many), and p.

    With S, the covariance of k - 1 orthonormal contrasts, ε is (tr S)² / ((k - 1) tr S²) (Box,
    1954).
    """
    n, k = table.shape[-2:]
    scores = table @ scipy.linalg.helmert(k).T  # (…, n, k - 1)
    means = scores.mean(axis=-2)
    centred = scores - means[..., None, :]
    covariance = np.swapaxes(centred, -1, -2) @ centred / (n - 1.0)
    trace = np.trace(covariance, axis1=-2, axis2=-1)
    f = n * (means**2).sum(axis=-1) / trace
    df = trace**2 / (covariance**2).sum(axis=(-1, -2))  # ε·(k - 1)
    return f, df, np.asarray(scipy.special.fdtrc(df, df * (n - 1.0), f))


# --- relations, and several tests -----------------------------------------------------------------


def correlation(first: Floats, second: Floats) -> Test:
    given = np.isfinite(first) & np.isfinite(second)
    x, y = tied(first[given]), tied(second[given])
    n, name = len(x), "Spearman ρ"
    if n < 4:
        return Test(name, n, remark="fewer than four participants")
    if (x == x[0]).all() or (y == y[0]).all():
        return Test(name, n, remark=NO_VARIANCE)
    rho, p = map(float, scipy.stats.spearmanr(x, y))
    effect = by_fisher(rho, math.sqrt((1.0 + rho * rho / 2.0) / (n - 3)))
    return Test(name, n, rho, (n - 2.0,), p, effect_name="ρ", effect=effect)


def by_fisher(size: float, error: float) -> IntervalEstimate:
    """Return a number in [-1, 1] with its interval by Fisher's z of standard error `error`."""
    if abs(size) >= 1.0:
        return IntervalEstimate(size)
    centre, slack = math.atanh(size), Z * error
    return IntervalEstimate(size, math.tanh(centre - slack), math.tanh(centre + slack))


def holm(values: Sequence[float], members: Sequence[Hashable] | None = None) -> tuple[float, ...]:
    """Return p values corrected by Holm's method; NaN stays, and does not count. Tests with equal
    `members` are one: the same test under two names is corrected for once, and has one p value.
    """
    named = range(len(values)) if members is None else members
    distinct = {member: p for member, p in zip(named, values, strict=True) if math.isfinite(p)}
    corrected = holm_rows(np.array(list(distinct.values()), dtype=np.float64)).tolist()
    found = dict(zip(distinct, corrected, strict=True))
    return tuple(found.get(member, math.nan) for member in named)


def holm_rows(values: Floats) -> Floats:
    """Return p values, (…, tests), corrected by Holm's method along the last axis."""
    count = values.shape[-1]
    order = np.argsort(values, axis=-1)
    ordered = np.take_along_axis(values, order, axis=-1) * np.arange(count, 0, -1)
    corrected = np.minimum(np.maximum.accumulate(ordered, axis=-1), 1.0)
    found = np.empty_like(values)
    np.put_along_axis(found, order, corrected, axis=-1)
    return found
