"""Models of several effects: the columns of their design, and their results.

A term is a factor, a number (a covariate), or an interaction. The levels of a factor are coded as
sums (effects around the grand mean; the last level is minus the sum of the others) or by treatment
(the first level is the reference). Terms are always tested in sum coding: by treatment, what a
model with an interaction calls the effect of a factor is its effect at the first level of the other
one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np

from experiments.analysis.statistics.comparisons import UNKNOWN, IntervalEstimate
from experiments.dataset.columns import Floats

Coding = Literal["treatment", "sum"]
Levels = Mapping[str, Sequence[str]]  # of each factor, in order; a covariate has none
Row = Mapping[str, str | float]  # the level of each factor, and the number of each covariate
INTERCEPT = "(intercept)"


class CannotFitError(ValueError):
    """The model has no answer for these data; says why."""


@dataclass(frozen=True)
class Design:
    """The columns of a model, (n, k), their names, and their terms (0 is the intercept)."""

    columns: Floats
    names: tuple[str, ...]
    terms: tuple[int, ...]

    def places(self, term: int) -> list[int]:
        """Return the columns of a term, by its number from 1."""
        return [at for at, own in enumerate(self.terms) if own == term]

    def difference(self, term: int, half: IntervalEstimate) -> IntervalEstimate:
        """Return the first of two levels less the second: twice the coefficient in sum coding."""
        (place, *others) = self.places(term)
        name = self.names[place]
        if others or ":" in name or " " not in name:  # an interaction, or a covariate
            return UNKNOWN
        return IntervalEstimate(2.0 * half.value, 2.0 * half.low, 2.0 * half.high)


@dataclass(frozen=True)
class Coefficient:
    name: str
    estimate: IntervalEstimate
    error: float
    t: float
    df: float
    p: float


@dataclass(frozen=True)
class TermTest:
    """An F test that all coefficients of a term are 0; `difference` is of a factor's two levels."""

    name: str
    f: float
    df: tuple[float, float]
    p: float
    difference: IntervalEstimate = UNKNOWN


@dataclass(frozen=True)
class FittedModel:
    """A fitted model; `spreads` are SDs and an ICC, `remark` what to note about the fit."""

    participants: int
    observations: int
    coefficients: tuple[Coefficient, ...]
    terms: tuple[TermTest, ...]
    spreads: tuple[tuple[str, float], ...] = ()
    remark: str = ""


def design_of(
    levels: Levels, terms: Sequence[str], rows: Sequence[Row], coding: Coding = "sum"
) -> Design:
    """Return the columns of a model; terms are factors, covariates, or several with colons between.
    Raises CannotFitError where a factor has only one level.
    """
    columns, names, places = [np.ones(len(rows))], [INTERCEPT], [0]
    for number, term in enumerate(terms, start=1):
        parts = [_coded(name, levels.get(name, ()), rows, coding) for name in term.split(":")]
        for combination in product(*parts):
            columns.append(np.prod([column for _, column in combination], axis=0))
            names.append(":".join(name for name, _ in combination))
            places.append(number)
    return Design(np.column_stack(columns), tuple(names), tuple(places))


def _coded(
    name: str, levels: Sequence[str], rows: Sequence[Row], coding: Coding
) -> list[tuple[str, Floats]]:
    given = [row[name] for row in rows]
    if len(levels) == 1:
        raise CannotFitError(f"only one level of {name} has data")
    if not levels:  # a covariate, around its mean
        numbers = np.array(given, dtype=np.float64)
        return [(name, numbers - numbers.mean())]
    columns = {level: np.array([float(one == level) for one in given]) for level in levels}
    if coding == "treatment":
        return [(f"{name} {level}", columns[level]) for level in levels[1:]]
    return [(f"{name} {level}", columns[level] - columns[levels[-1]]) for level in levels[:-1]]


def check_data(outcome: Floats, columns: Floats, people: int) -> None:
    """Raise CannotFitError for data to which no model can be fitted."""
    n, k = columns.shape
    if people < 3:
        raise CannotFitError("fewer than three participants")
    if np.ptp(outcome) <= 1e-9 * np.abs(outcome).max():
        raise CannotFitError("no variance: all values are equal")
    if np.linalg.matrix_rank(columns) < k:
        raise CannotFitError("some effects cannot be told apart with these data")
    if n - k < 1:
        raise CannotFitError("too few observations for so many effects")
