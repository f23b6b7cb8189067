"""Linear mixed models with an intercept for each participant, fitted by REML, with tests that hold
for any covariance of a participant's values.

With one variance between participants, the restricted likelihood depends on one number alone: the
ratio λ of that variance to the residual one (Laird and Ware, 1982). So the fit is a search along a
line, with least squares at each ratio, also at 0 (participants who do not differ). If each
participant was measured once, this is a linear model.

Such a model assumes that all conditions have the same variance and all pairs of them the same
covariance. The tests do not: covariances of the coefficients are estimated from the residuals of
each participant, corrected for bias (CR2), and degrees of freedom are estimated (Satterthwaite,
HTZ), as R's clubSandwich does. docs/explanation/statistics.md has the sources.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
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
LEAST_DF = 1e-3  # of a denominator; less is rounding of 0


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
    """Fit a model to observations of the participants in `who`; may raise CannotFitError."""
    groups, people = grouped(who)
    check_data(outcome, design.columns, people)
    found = reml(outcome, design.columns, groups, people)
    robust = RobustTests(design.columns, groups, found.ratio)
    coefficients = [robust.coefficient(outcome, at, one) for at, one in enumerate(design.names)]
    tests = []
    for number, name in enumerate(terms, start=1):
        places = design.places(number)
        first = coefficients[places[0]]
        single = (first.t**2, (1.0, first.df))
        f, df = single if len(places) == 1 else robust.wald(outcome, places)
        difference = design.difference(number, first.estimate)
        tests.append(TermTest(name, float(f), df, float(p_of(np.array(f), df)), difference))
    spreads, remark = [("SD residual", math.sqrt(found.residual))], ""
    if len(outcome) > people:
        sd = math.sqrt(found.ratio * found.residual)
        share = found.ratio / (1.0 + found.ratio)
        spreads = [("SD participants", sd), *spreads, ("ICC", share)]
        remark = "" if found.ratio else "participants do not differ (variance 0)"
    n = len(outcome)
    return FittedModel(people, n, tuple(coefficients), tuple(tests), tuple(spreads), remark)


def grouped(who: Sequence[str]) -> tuple[Any, int]:
    """Return the participant of each observation, as a number from 0, and how many there are."""
    _, groups = np.unique(np.asarray(who), return_inverse=True)
    return groups, int(groups.max(initial=-1)) + 1


# --- the fit --------------------------------------------------------------------------------------


def reml(outcome: Floats, columns: Floats, groups: Any, people: int) -> RemlFit:
    """Return the fit of the least deviance: the best ratio of a grid, refined between its
    neighbours; 0 where no other is better, or where each participant was measured once.
    """
    data = np.column_stack((columns, outcome))
    counts = np.bincount(groups, minlength=people)
    means = np.zeros((people, data.shape[1]))
    np.add.at(means, groups, data)
    means = (means / counts[:, None])[groups]

    at = partial(_least_squares, data, means, groups, counts)
    deviance, without = at(0.0)
    if len(outcome) == people:
        return without
    place = int(np.argmin([at(math.exp(power))[0] for power in GRID]))
    found = scipy.optimize.minimize_scalar(
        lambda power: at(math.exp(power))[0],
        bounds=(GRID[max(place - 1, 0)], GRID[min(place + 1, len(GRID) - 1)]),
        method="bounded",
        options={"xatol": TIGHT},
    )
    return at(math.exp(float(found.x)))[1] if found.fun < deviance else without


def _least_squares(
    data: Floats, means: Floats, groups: Any, counts: Any, ratio: float
) -> tuple[float, RemlFit]:
    """Return -2 log restricted likelihood (but for a constant) and the fit at a ratio: least
    squares after 1 - 1/√(1 + nλ) of a participant's mean is subtracted from each of its n values,
    which makes them independent. `data` and `means` are columns and outcome, (n, k + 1).
    """
    inflation = 1.0 + counts * ratio
    reduced = data - (1.0 - 1.0 / np.sqrt(inflation))[groups, None] * means
    x, y = reduced[:, :-1], reduced[:, -1]
    xx = x.T @ x
    estimates = np.linalg.solve(xx, x.T @ y)
    freedom = len(y) - len(xx)
    residual = float(((y - x @ estimates) ** 2).sum()) / freedom
    if residual <= ROUNDING * float(y @ y) / len(y):
        raise CannotFitError("no variance: the effects explain everything")
    deviance = float(np.log(inflation).sum() + np.linalg.slogdet(xx)[1])
    deviance += freedom * math.log(residual)
    return deviance, RemlFit(ratio, estimates, np.linalg.inv(xx) * residual, residual)


# --- the tests ------------------------------------------------------------------------------------


class RobustTests:
    """Tests of coefficients by the residuals of each participant. All but the residuals depends on
    the design and the ratio of variances alone, so that many outcomes of one design are tested at
    once: `outcomes` are (…, n).

    In the notation of Pustejovsky and Tipton (2018): Φ = I + λJ is the working covariance of a
    participant's values, W its inverse, M = (ΣXᵀWX)⁻¹, and G = XᵀWA weights a participant's
    residuals, with A such that A(Φ - XMXᵀ)Aᵀ = Φ on average undoes that residuals are too small.
    """

    def __init__(self, columns: Floats, groups: Any, ratio: float) -> None:
        self._columns = columns
        self._rows = [np.flatnonzero(groups == one) for one in range(int(groups.max()) + 1)]
        self._covariances = [np.eye(len(rows)) + ratio for rows in self._rows]
        weighted = np.empty_like(columns)  # W X
        for rows, own in zip(self._rows, self._covariances, strict=True):
            weighted[rows] = np.linalg.solve(own, columns[rows])
        self._bread = np.asarray(np.linalg.inv(columns.T @ weighted), dtype=np.float64)  # M
        self._weights = self._bread @ weighted.T  # estimates = weights · outcome
        self._adjusted = []  # M G of each participant, (k, own observations)
        for rows, own in zip(self._rows, self._covariances, strict=True):
            x, root = columns[rows], np.linalg.cholesky(own).T  # Φ = rootᵀ·root
            inner = root @ (own - x @ self._bread @ x.T) @ root.T
            adjust = root.T @ _inverse_root(inner, float((own**2).sum())) @ root
            self._adjusted.append(self._weights[:, rows] @ adjust)

    def estimates(self, outcomes: Floats) -> Floats:
        return np.asarray(outcomes @ self._weights.T)

    def wald(self, outcomes: Floats, places: Sequence[int]) -> tuple[Floats, tuple[float, float]]:
        """Return F that the coefficients at some places are all 0, (…,), and its degrees of
        freedom. Their covariance has about η times a Wishart distribution, with the total variance
        that it has under the working covariance.
        """
        own = list(places)
        estimates = self.estimates(outcomes)
        covariance = self._covariance(outcomes, estimates, own)
        size, eta = len(own), self._freedom(own)
        if eta - size + 1.0 < LEAST_DF:
            raise CannotFitError("too few participants for so many levels")
        if (np.linalg.matrix_rank(covariance, rtol=1e-10) < size).any():
            raise CannotFitError("no variance within participants")
        values = estimates[..., own]
        wald = (values * np.linalg.solve(covariance, values[..., None])[..., 0]).sum(axis=-1)
        return (eta - size + 1.0) / (eta * size) * wald, (float(size), eta - size + 1.0)

    def _covariance(self, outcomes: Floats, estimates: Floats, own: Sequence[int]) -> Floats:
        residuals = outcomes - estimates @ self._columns.T
        people = zip(self._rows, self._adjusted, strict=True)
        parts = [residuals[..., rows] @ adjusted[own].T for rows, adjusted in people]
        scores = np.stack(parts, axis=-2)  # (…, participants, coefficients)
        return np.asarray(np.swapaxes(scores, -1, -2) @ scores)

    def _freedom(self, own: Sequence[int]) -> float:
        """Return η. P, the covariance of the standardized scores t of all participants under the
        working covariance, has a block for each two of them; the total variance of Σttᵀ is the sum
        of (tr P)² + tr P² over the blocks, and that of the Wishart distribution q(q + 1) / η.
        """
        scale = _inverse_root(self._bread[np.ix_(own, own)])
        parts = [scale @ adjusted[own] for adjusted in self._adjusted]
        people = zip(parts, self._rows, strict=True)
        fitted = np.stack([part @ self._columns[rows] for part, rows in people])  # (people, q, k)
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
        estimates, df = self.estimates(outcome), self._freedom([place])
        value = float(estimates[place])
        error = math.sqrt(float(self._covariance(outcome, estimates, [place])[0, 0]))
        return coefficient(name, value, error, df)


def coefficient(name: str, value: float, error: float, df: float) -> Coefficient:
    slack = float(scipy.special.stdtrit(df, UPPER)) * error
    t = value / error
    p = float(2.0 * scipy.special.stdtr(df, -abs(t)))
    return Coefficient(name, IntervalEstimate(value, value - slack, value + slack), error, t, df, p)


def p_of(f: Floats, df: tuple[float, float]) -> Floats:
    return np.asarray(scipy.special.fdtrc(*df, f))


def _inverse_root(matrix: Floats, scale: float = 0.0) -> Floats:
    """Return the inverse of a matrix's symmetric root, without directions whose variance is
    rounding beside the largest one, or beside `scale`.
    """
    values, vectors = np.linalg.eigh(matrix)
    least = 1e-10 * max(scale, float(values[-1]))
    inverse = np.where(values > least, 1.0 / np.sqrt(np.maximum(values, least)), 0.0)
    return np.asarray((vectors * inverse) @ vectors.T)
