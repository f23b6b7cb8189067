"""Many outcomes of one design at once, as a simulation of power needs them: the same model as in
mixed_models.py, fitted to all of them together.

What does not depend on the outcome (the design, and who is measured how often) is computed once;
each ratio λ of variances is tried on every outcome in one call. The best ratio of each is found on
the same grid and refined by golden sections (Press et al., Numerical Recipes, 10.1).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from experiments.analysis.dataset.records import Floats
from experiments.analysis.statistics.mixed_models import GRID, Design, check_data, freedom_of

GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
SECTIONS = 40  # of a bracket of two units of log λ: below 1e-8


@dataclass(frozen=True, eq=False)
class _BatchSums:
    """Sums over observations, and over those of each participant: XᵀX (k, k); Xᵀy (m, k) and yᵀy
    (m,) of m outcomes; per participant x (people, k), y (m, people) and counts (people,).
    """

    xx: Floats
    xy: Floats
    yy: Floats
    columns: Floats
    outcomes: Floats
    counts: Floats
    observations: int


def term_p_values(
    outcomes: Floats, design: Design, terms: Sequence[str], who: Sequence[str]
) -> Floats:
    """Return the p values of Wald's F tests of each term, (m, terms), of m outcomes, (m, n).

    Raises:
        CannotFitError: the design has no answer, whatever the outcome.
    """
    _, groups = np.unique(np.asarray(who), return_inverse=True)
    people = int(groups.max(initial=-1)) + 1
    check_data(outcomes[0], design.columns, people)
    member = np.zeros((people, outcomes.shape[1]))
    member[groups, np.arange(len(groups))] = 1.0
    sums = _BatchSums(
        design.columns.T @ design.columns,
        outcomes @ design.columns,
        (outcomes**2).sum(axis=1),
        member @ design.columns,
        outcomes @ member.T,
        member.sum(axis=1),
        outcomes.shape[1],
    )
    _, estimates, information, residual = _profiles(sums, _best_ratios(sums))
    covariance = np.linalg.inv(information) * residual[:, None, None]
    df = freedom_of(design, groups, people)
    found = [
        _wald(estimates, covariance, [at for at, term in enumerate(design.terms) if term == n], df)
        for n in range(1, len(terms) + 1)
    ]
    return np.stack(found, axis=1)


def _profiles(sums: _BatchSums, ratios: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Return deviance (m,), estimates (m, k), information (m, k, k) and residual variance (m,) at a
    ratio for each outcome, (m,): mixed_models._profile for all at once.
    """
    weights = ratios[:, None] / (1.0 + ratios[:, None] * sums.counts)  # (m, people)
    size = sums.columns.shape[1]
    outer = (sums.columns[:, :, None] * sums.columns[:, None, :]).reshape(len(sums.counts), -1)
    xx = sums.xx - (weights @ outer).reshape(-1, size, size)
    xy = sums.xy - (weights * sums.outcomes) @ sums.columns
    yy = sums.yy - (weights * sums.outcomes**2).sum(axis=1)
    estimates = np.asarray(np.linalg.solve(xx, xy[:, :, None])[:, :, 0], dtype=np.float64)
    freedom = sums.observations - size
    residual = np.maximum(yy - (estimates * xy).sum(axis=1), 0.0) / freedom
    spread = np.log1p(ratios[:, None] * sums.counts).sum(axis=1)
    deviance: Floats = spread + np.linalg.slogdet(xx)[1] + freedom * np.log(residual)
    return deviance, estimates, xx, residual


def _best_ratios(sums: _BatchSums) -> Floats:
    """Return the ratio of the least deviance of each outcome; 0 where none is better than that."""
    count = len(sums.yy)
    grid = [_profiles(sums, np.full(count, math.exp(power)))[0] for power in GRID]
    place = np.argmin(np.stack(grid), axis=0)
    low = GRID[np.maximum(place - 1, 0)]
    high = GRID[np.minimum(place + 1, len(GRID) - 1)]
    ratios: Floats = np.exp(_golden(sums, low, high))
    is_better = _profiles(sums, ratios)[0] < _profiles(sums, np.zeros(count))[0]
    return np.where(is_better, ratios, 0.0)


def _golden(sums: _BatchSums, low: Floats, high: Floats) -> Floats:
    inner, outer = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    at_inner, at_outer = (_profiles(sums, np.exp(one))[0] for one in (inner, outer))
    for _ in range(SECTIONS):
        is_left = at_inner < at_outer
        low, high = np.where(is_left, low, inner), np.where(is_left, outer, high)
        kept = np.where(is_left, inner, outer)
        at_kept = np.where(is_left, at_inner, at_outer)
        new = np.where(is_left, high - GOLDEN * (high - low), low + GOLDEN * (high - low))
        at_new = _profiles(sums, np.exp(new))[0]
        inner, outer = np.where(is_left, new, kept), np.where(is_left, kept, new)
        at_inner, at_outer = np.where(is_left, at_new, at_kept), np.where(is_left, at_kept, at_new)
    return (low + high) / 2.0


def _wald(estimates: Floats, covariance: Floats, own: Sequence[int], df: Sequence[float]) -> Floats:
    values = estimates[:, own]
    inside = covariance[:, own][:, :, own]
    wald = (values * np.linalg.solve(inside, values[:, :, None])[:, :, 0]).sum(axis=1)
    freedom = (float(len(own)), min(df[place] for place in own))
    return np.asarray(scipy.special.fdtrc(*freedom, wald / len(own)))
