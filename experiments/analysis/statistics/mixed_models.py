"""Linear mixed models with an intercept for each participant, fitted by REML, with tests that hold
for any covariance of a participant's values.

With one variance between participants, the restricted likelihood depends on one number alone: the
ratio λ of that variance to the residual one. Everything else follows from it by generalized least
squares (Laird and Ware, 1982), so the fit is a search along a line, and a ratio of 0 (participants
who do not differ) is tried like any other. tests/unit/experiments/analysis/statistics/ compares the
fits with those of lme4. Of participants who were measured once each, this is a linear model.

Such a model assumes that all conditions have the same variance and all pairs of them the same
covariance (compound symmetry). The tests do not: covariances of the coefficients are estimated from
the residuals of each participant, corrected for bias ("CR2": Bell and McCaffrey, 2002; Pustejovsky
and Tipton, 2018), t has the degrees of freedom of Satterthwaite, and the test of a term is that of
Hotelling's T² with estimated degrees of freedom ("HTZ": Tipton and Pustejovsky, 2015). In a
balanced study within participants these are the paired t test of each participant's means, and the
test of the multivariate analysis of variance, whose covariance is unstructured; so no sphericity is
assumed. R's clubSandwich computes the same, and the tests compare with it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from experiments.analysis.statistics.comparisons import UPPER, IntervalEstimate
from experiments.analysis.statistics.models import (
    CannotFitError,
    Coefficient,
    Design,
    FittedModel,
    TermTest,
    check_data,
)
from experiments.dataset.columns import Floats

GRID = np.arange(-14.0, 15.0)  # logarithms of ratios
TIGHT = 1e-9  # of the logarithm of the ratio
ROUNDING = 1e-14
LEAST_DF = 1e-3  # of a denominator; less is none, but for rounding


@dataclass(frozen=True, eq=False)
class RemlFit:
    """A model at its best ratio of variances λ: coefficients (k,), the covariance that the model
    gives them (k, k), and the residual variance.
    """

    ratio: float
    estimates: Floats
    covariance: Floats
    residual: float


def fit(outcome: Floats, design: Design, terms: Sequence[str], who: Sequence[str]) -> FittedModel:
    """Fit a model to observations of participants.

    Raises:
        CannotFitError: there are too few data, no variance, or columns that depend on each other.
    """
    groups, people = grouped(who)
    check_data(outcome, design.columns, people)
    found = reml(outcome, design.columns, groups, people)
    robust = RobustTests(design.columns, groups, found.ratio)
    between, within = found.ratio * found.residual, found.residual
    spreads = (
        ("SD participants", math.sqrt(between)),
        ("SD residual", math.sqrt(within)),
        ("ICC", between / (between + within)),
    )
    coefficients = [robust.coefficient(outcome, at, one) for at, one in enumerate(design.names)]
    tests = []
    for number, name in enumerate(terms, start=1):
        places = design.places(number)
        first = coefficients[places[0]]
        one = (first.t**2, (1.0, first.df))
        f, df = one if len(places) == 1 else robust.wald(outcome, places)
        difference = design.difference(number, first.estimate)
        tests.append(TermTest(name, float(f), df, float(p_of(np.array(f), df)), difference))
    remark = "participants do not differ (variance 0)" if len(outcome) > people else ""
    return FittedModel(
        people,
        len(outcome),
        tuple(coefficients),
        tuple(tests),
        spreads if len(outcome) > people else (("SD residual", math.sqrt(within)),),
        remark if found.ratio == 0.0 else "",
    )


def grouped(who: Sequence[str]) -> tuple[Any, int]:
    """Return the participant of each observation, as a number from 0, and how many there are."""
    _, groups = np.unique(np.asarray(who), return_inverse=True)
    return groups, int(groups.max(initial=-1)) + 1


# --- the fit --------------------------------------------------------------------------------------


def reml(outcome: Floats, columns: Floats, groups: Any, people: int) -> RemlFit:
    """Return the fit of the least deviance: the best ratio of a grid, refined between its
    neighbours; 0 where none is better than that, or nobody was measured twice.
    """
    sums = _Sums.of(outcome, columns, groups, people)

    def deviance(power: float) -> float:
        return _profile(sums, math.exp(power))[0]

    ratio = 0.0
    if len(outcome) > people:
        place = int(np.argmin([deviance(power) for power in GRID]))
        found = scipy.optimize.minimize_scalar(
            deviance,
            bounds=(GRID[max(place - 1, 0)], GRID[min(place + 1, len(GRID) - 1)]),
            method="bounded",
            options={"xatol": TIGHT},
        )
        ratio = math.exp(float(found.x)) if found.fun < _profile(sums, 0.0)[0] else 0.0
    return _profile(sums, ratio)[1]


@dataclass(frozen=True, eq=False)
class _Sums:
    """What every ratio is tried on, so that the observations are read once: XᵀX (k, k), Xᵀy (k,)
    and yᵀy of all of them; of each participant the sums of X (people, k) and of y (people,), and
    the number of observations (people,).
    """

    xx: Floats
    xy: Floats
    yy: float
    columns: Floats
    outcomes: Floats
    counts: Floats

    @classmethod
    def of(cls, outcome: Floats, columns: Floats, groups: Any, people: int) -> "_Sums":
        """Return the sums of observations `outcome` (n,) and `columns` (n, k) of `groups` (n,)."""
        of_participants = np.zeros((people, columns.shape[1]))
        np.add.at(of_participants, groups, columns)
        return cls(
            columns.T @ columns,
            columns.T @ outcome,
            float(outcome @ outcome),
            of_participants,
            np.asarray(np.bincount(groups, outcome, people), dtype=np.float64),
            np.bincount(groups, minlength=people).astype(np.float64),
        )


def _profile(sums: _Sums, ratio: float) -> tuple[float, RemlFit]:
    """Return -2 log restricted likelihood (but for a constant) and the fit at a ratio: generalized
    least squares with V = σ²(I + λJ) for each participant, whose inverse is
    (I - λ / (1 + nλ) J) / σ² and whose determinant is (1 + nλ) σ²ⁿ.
    """
    weights = ratio / (1.0 + sums.counts * ratio)
    weighted = sums.columns.T * weights  # (k, people)
    xx: Floats = sums.xx - weighted @ sums.columns
    xy: Floats = sums.xy - weighted @ sums.outcomes
    yy = sums.yy - float(weights @ np.square(sums.outcomes))
    n, size = int(sums.counts.sum()), len(xy)
    estimates = np.asarray(np.linalg.solve(xx, xy), dtype=np.float64)
    residual = max(yy - float(estimates @ xy), 0.0) / (n - size)
    if residual <= ROUNDING * yy / n:
        raise CannotFitError("no variance: the effects explain everything")
    spread = float(np.log1p(sums.counts * ratio).sum())
    deviance = spread + float(np.linalg.slogdet(xx)[1]) + (n - size) * math.log(residual)
    covariance = np.asarray(np.linalg.inv(xx), dtype=np.float64) * residual
    return deviance, RemlFit(ratio, estimates, covariance, residual)


# --- the tests ------------------------------------------------------------------------------------


class RobustTests:
    """Tests of coefficients by the residuals of each participant. All but those depends on the
    design and the ratio of variances alone, so that many outcomes of one design are tested at once:
    `outcomes` are (…, n).

    In the notation of Pustejovsky and Tipton (2018): Φ = I + λJ is the working covariance of a
    participant's values, W its inverse, M = (ΣXᵀWX)⁻¹, and G = XᵀWA weights a participant's
    residuals, with A such that A(Φ - XMXᵀ)Aᵀ = Φ on average undoes that residuals are too small.
    """

    def __init__(self, columns: Floats, groups: Any, ratio: float) -> None:
        self._columns = columns
        self._rows = [np.flatnonzero(groups == one) for one in range(int(groups.max()) + 1)]
        parts = [columns[rows] for rows in self._rows]
        covariances = [np.eye(len(rows)) + ratio for rows in self._rows]
        weighted = [np.linalg.solve(own, x) for own, x in zip(covariances, parts, strict=True)]
        self._bread = np.linalg.inv(sum(x.T @ w for x, w in zip(parts, weighted, strict=True)))
        self._weights = np.empty((columns.shape[1], len(columns)))  # estimates = weights · outcome
        self._adjusted = []  # M G of each participant, (k, own observations)
        self._covariances = covariances
        for rows, x, w, own in zip(self._rows, parts, weighted, covariances, strict=True):
            self._weights[:, rows] = self._bread @ w.T
            root = np.linalg.cholesky(own).T  # Φ = rootᵀ·root
            inner = root @ (own - x @ self._bread @ x.T) @ root.T
            adjust = root.T @ _inverse_root(inner, float((own**2).sum())) @ root
            self._adjusted.append(self._bread @ w.T @ adjust)

    def estimates(self, outcomes: Floats) -> Floats:
        """Return the coefficients, (…, k)."""
        return np.asarray(outcomes @ self._weights.T)

    def wald(self, outcomes: Floats, places: Sequence[int]) -> tuple[Floats, tuple[float, float]]:
        """Return F that the coefficients at some places are all 0, (…,), and its degrees of
        freedom.

        Their covariance has about η times a Wishart distribution; η is such that its total variance
        is the one under the working covariance.
        """
        own = list(places)
        estimates = self.estimates(outcomes)
        covariance = self._covariance(outcomes, estimates, own)
        values = estimates[..., own]
        wald = (values * np.linalg.solve(covariance, values[..., None])[..., 0]).sum(axis=-1)
        size, eta = len(own), self._freedom(own)
        if eta - size + 1.0 < LEAST_DF:
            raise CannotFitError("too few participants for so many levels")
        return (eta - size + 1.0) / (eta * size) * wald, (float(size), eta - size + 1.0)

    def _covariance(self, outcomes: Floats, estimates: Floats, own: Sequence[int]) -> Floats:
        residuals = outcomes - estimates @ self._columns.T
        scores = np.stack(
            [
                residuals[..., rows] @ adjusted[own].T
                for rows, adjusted in zip(self._rows, self._adjusted, strict=True)
            ],
            axis=-2,
        )  # (…, participants, coefficients)
        return np.asarray(np.swapaxes(scores, -1, -2) @ scores)

    def _freedom(self, own: Sequence[int]) -> float:
        """Return η. P, the covariance of the standardized scores t of all participants under the
        working covariance, has a block for each two of them; the total variance of Σttᵀ is the sum
        of (tr P)² + tr P² over the blocks, and that of the Wishart distribution q(q + 1) / η.
        """
        scale = _inverse_root(self._bread[np.ix_(own, own)])
        parts = [scale @ adjusted[own] for adjusted in self._adjusted]
        fitted = np.stack(
            [part @ self._columns[rows] for part, rows in zip(parts, self._rows, strict=True)]
        )  # (participants, q, k)
        total = 0.0
        for at, (part, covariance) in enumerate(zip(parts, self._covariances, strict=True)):
            blocks = -np.einsum("ak,jbk->jab", fitted[at] @ self._bread, fitted)
            blocks[at] += part @ covariance @ part.T
            total += float((np.einsum("jaa->j", blocks) ** 2).sum())
            total += float(np.einsum("jab,jba->", blocks, blocks))
        if total < ROUNDING:
            raise CannotFitError("some effects have no variance within these data")
        return len(own) * (len(own) + 1.0) / total

    def coefficient(self, outcome: Floats, place: int, name: str) -> Coefficient:
        """Return one coefficient of one outcome, (n,)."""
        estimates, df = self.estimates(outcome), self._freedom([place])
        value = float(estimates[place])
        error = math.sqrt(float(self._covariance(outcome, estimates, [place])[0, 0]))
        return coefficient(name, value, error, df)


def coefficient(name: str, value: float, error: float, df: float) -> Coefficient:
    """Return a coefficient with what t makes of its standard error."""
    slack = float(scipy.special.stdtrit(df, UPPER)) * error
    t = value / error
    p = float(2.0 * scipy.special.stdtr(df, -abs(t)))
    return Coefficient(name, IntervalEstimate(value, value - slack, value + slack), error, t, df, p)


def p_of(f: Floats, df: tuple[float, float]) -> Floats:
    """Return the p values of F, (…,)."""
    return np.asarray(scipy.special.fdtrc(*df, f))


def _inverse_root(matrix: Floats, scale: float = 0.0) -> Floats:
    """Return the inverse of the symmetric root of a matrix, without directions whose variance is
    rounding beside the largest one, or beside `scale`.
    """
    values, vectors = np.linalg.eigh(matrix)
    least = 1e-10 * max(scale, float(values[-1]))
    inverse = np.where(values > least, 1.0 / np.sqrt(np.maximum(values, least)), 0.0)
    return np.asarray((vectors * inverse) @ vectors.T)
