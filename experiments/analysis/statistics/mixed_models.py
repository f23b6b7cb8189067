"""Linear mixed models with an intercept for each participant, fitted by REML.

With one variance between participants, the restricted likelihood depends on one number alone: the
ratio λ of that variance to the residual one. Everything else follows from it by generalized least
squares (Laird and Ware, 1982), so the fit is a search along a line, and a ratio of 0 (participants
who do not differ) is tried like any other. tests/unit/experiments/analysis/statistics/ compares the
fits with those of lme4.

A term is a factor or an interaction, whose levels are coded by treatment (the first level is the
reference) or as sums (effects around the grand mean; the last level is minus the sum of the
others). Terms are tested together by Wald's F, coefficients by t.

The denominator has the degrees of freedom of the between-within method (Schluchter and Elashoff,
1990) as R's nlme 3.1 computes them (`getFixDF`; its authors describe the rule in Pinheiro and
Bates, Mixed-Effects Models in S and S-PLUS, 2000, section 2.4.2). For a coefficient whose column
changes within participants they are the observations less participants less such coefficients; for
the others, the participants less those and the intercept; for the intercept, the larger of the two.
A term has the fewest that its coefficients have. In a balanced study these are the degrees of
freedom of the analysis of variance. The tests compare them with nlme's, too. Of a term of which
some coefficients change within participants and some do not, nlme counts all as changing.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, Literal

import numpy as np
import scipy

from experiments.analysis.dataset.records import Floats
from experiments.analysis.statistics.comparisons import UPPER, IntervalEstimate

Coding = Literal["treatment", "sum"]
INTERCEPT = "(intercept)"
GRID = np.arange(-14.0, 15.0)  # logarithms of ratios
TIGHT = 1e-9  # of the logarithm of the ratio
ROUNDING = 1e-14


class CannotFitError(ValueError):
    """The model has no answer for these data; says why."""


@dataclass(frozen=True)
class Design:
    """The columns of a model: (n, k), what each is called, and to which term it belongs (0 is the
    intercept).
    """

    columns: Floats
    names: tuple[str, ...]
    terms: tuple[int, ...]


@dataclass(frozen=True)
class Coefficient:
    """A coefficient of the model: its estimate with interval, standard error, t, df and p."""

    name: str
    estimate: IntervalEstimate
    error: float
    t: float
    df: float
    p: float


@dataclass(frozen=True)
class TermTest:
    """Wald's F test that all coefficients of a term are 0."""

    name: str
    f: float
    df: tuple[float, float]
    p: float


@dataclass(frozen=True)
class MixedModel:
    """A fitted model; standard deviations between participants and of the residuals."""

    participants: int
    observations: int
    coefficients: tuple[Coefficient, ...]
    terms: tuple[TermTest, ...]
    sd_participants: float
    sd_residual: float

    @property
    def is_singular(self) -> bool:
        """Tell whether participants were found not to differ at all."""
        return self.sd_participants == 0.0


def design_of(
    levels: Mapping[str, Sequence[str]],
    terms: Sequence[str],
    rows: Sequence[Mapping[str, str]],
    coding: Coding,
) -> Design:
    """Return the columns of a model.

    Args:
        levels: the levels of each factor, in order.
        terms: factors, or several with colons between.
        rows: the level of each factor, an observation each.
        coding: of the levels.
    """
    columns, names, places = [np.ones(len(rows))], [INTERCEPT], [0]
    for number, term in enumerate(terms, start=1):
        parts = [_coded(factor, levels[factor], rows, coding) for factor in term.split(":")]
        for combination in product(*parts):
            columns.append(np.prod([column for _, column in combination], axis=0))
            names.append(":".join(name for name, _ in combination))
            places.append(number)
    return Design(np.column_stack(columns), tuple(names), tuple(places))


def _coded(
    factor: str, levels: Sequence[str], rows: Sequence[Mapping[str, str]], coding: Coding
) -> list[tuple[str, Floats]]:
    given = [row[factor] for row in rows]
    own = levels[1:] if coding == "treatment" else levels[:-1]
    found = []
    for level in own:
        column = np.array([float(one == level) for one in given])
        if coding == "sum":
            column -= np.array([float(one == levels[-1]) for one in given])
        found.append((f"{factor} {level}", column))
    return found


def fit(outcome: Floats, design: Design, terms: Sequence[str], who: Sequence[str]) -> MixedModel:
    """Fit a model to observations of participants.

    Raises:
        CannotFitError: there are too few data, no repetition, no variance, or columns that depend
            on each other.
    """
    _, groups = np.unique(np.asarray(who), return_inverse=True)
    people = int(groups.max(initial=-1)) + 1
    check_data(outcome, design.columns, people)
    sums = _Sums.of(outcome, design.columns, groups, people)
    ratio = _best_ratio(sums)
    found = _profile(sums, ratio)
    estimates = found.estimates
    covariance = np.asarray(np.linalg.inv(found.information), dtype=np.float64) * found.residual
    df = freedom_of(design, groups, people)
    return MixedModel(
        people,
        len(outcome),
        tuple(
            _coefficient(name, float(value), math.sqrt(variance), freedom)
            for name, value, variance, freedom in zip(
                design.names, estimates, np.diag(covariance), df, strict=True
            )
        ),
        tuple(
            _term_test(name, number, design, estimates, covariance, df)
            for number, name in enumerate(terms, start=1)
        ),
        math.sqrt(ratio * found.residual),
        math.sqrt(found.residual),
    )


def check_data(outcome: Floats, columns: Floats, people: int) -> None:
    """Refuse data to which no model can be fitted.

    Raises:
        CannotFitError: as `fit` does.
    """
    n, k = columns.shape
    if people < 3:
        raise CannotFitError("fewer than three participants")
    if n <= people:
        raise CannotFitError("no participant was measured twice")
    if np.ptp(outcome) <= 1e-9 * np.abs(outcome).max():
        raise CannotFitError("no variance: all values are equal")
    if np.linalg.matrix_rank(columns) < k:
        raise CannotFitError("some effects cannot be told apart with these data")
    if n - people - k < 1:
        raise CannotFitError("too few observations for so many effects")


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


@dataclass(frozen=True)
class _Profile:
    """What follows from a ratio: -2 log restricted likelihood (but for a constant), coefficients,
    XᵀV⁻¹X in units of the residual variance, and that variance.
    """

    deviance: float
    estimates: Floats
    information: Floats
    residual: float


def _profile(sums: _Sums, ratio: float) -> _Profile:
    """Fit by generalized least squares with V = σ²(I + λJ) for each participant, whose inverse is
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
    return _Profile(deviance, estimates, xx, residual)


def _deviances(sums: _Sums, ratios: Floats) -> Floats:
    """Return the deviance of `_profile` at each of several ratios (g,), all at once."""
    ratios = ratios[:, None]
    weights = ratios / (1.0 + sums.counts * ratios)  # (g, people)
    xx = sums.xx - (sums.columns.T * weights[:, None, :]) @ sums.columns
    xy = sums.xy - (weights * sums.outcomes) @ sums.columns
    yy = sums.yy - weights @ np.square(sums.outcomes)
    n, size = int(sums.counts.sum()), xy.shape[1]
    explained = (np.linalg.solve(xx, xy[:, :, None])[:, :, 0] * xy).sum(axis=1)
    residuals = np.maximum(yy - explained, 0.0) / (n - size)
    if (residuals <= ROUNDING * yy / n).any():
        raise CannotFitError("no variance: the effects explain everything")
    spread = np.log1p(sums.counts * ratios).sum(axis=1)
    found: Floats = spread + np.linalg.slogdet(xx)[1] + (n - size) * np.log(residuals)
    return found


def _best_ratio(sums: _Sums) -> float:
    """Return the ratio of the least deviance: the best of a grid, refined between its neighbours; 0
    where none is better than that.
    """
    place = int(np.argmin(_deviances(sums, np.exp(GRID))))
    found = scipy.optimize.minimize_scalar(
        lambda power: _profile(sums, math.exp(power)).deviance,
        bounds=(GRID[max(place - 1, 0)], GRID[min(place + 1, len(GRID) - 1)]),
        method="bounded",
        options={"xatol": TIGHT},
    )
    ratio = math.exp(float(found.x))
    return ratio if _profile(sums, ratio).deviance < _profile(sums, 0.0).deviance else 0.0


def freedom_of(design: Design, groups: Any, people: int) -> list[float]:
    """Return the denominator's degrees of freedom of each coefficient."""
    changes = [
        any(np.ptp(column[groups == group]) > 0.0 for group in range(people))
        for column in design.columns.T
    ]
    n = len(design.columns)
    inner = float(n - people - sum(changes))
    outer = float(people - sum(not one for one in changes))  # the intercept among them
    return [
        max(inner, outer) if place == 0 else inner if one else outer
        for one, place in zip(changes, design.terms, strict=True)
    ]


def _coefficient(name: str, value: float, error: float, df: float) -> Coefficient:
    t = value / error
    slack = float(scipy.special.stdtrit(df, UPPER)) * error
    p = float(2.0 * scipy.special.stdtr(df, -abs(t)))
    return Coefficient(name, IntervalEstimate(value, value - slack, value + slack), error, t, df, p)


def _term_test(
    name: str,
    number: int,
    design: Design,
    estimates: Floats,
    covariance: Floats,
    df: Sequence[float],
) -> TermTest:
    own = [place for place, term in enumerate(design.terms) if term == number]
    values = estimates[own]
    wald = float(values @ np.linalg.solve(covariance[np.ix_(own, own)], values))
    freedom = (float(len(own)), min(df[place] for place in own))
    f = wald / len(own)
    return TermTest(name, f, freedom, float(scipy.special.fdtrc(*freedom, f)))
