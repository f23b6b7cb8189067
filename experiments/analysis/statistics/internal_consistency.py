"""How well the items of a scale agree: alpha (Cronbach, 1951; interval: Feldt, 1965), and omega
(McDonald, 1999), (Σλ)² / ((Σλ)² + Σψ) of a model with one factor, whose interval is Wald's on
the logit scale, from the expected information (Kelley and Pornprasertmanit, 2016, "MLL").

Items are (n, k): a row a participant who answered all of them, a column an item, reverse-coded ones
counted from the other end.
"""

import math
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy

from experiments.analysis.statistics.comparisons import (
    LOWER,
    UPPER,
    IntervalEstimate,
    Z,
    is_constant,
)
from experiments.dataset.columns import Floats

LEAST_UNIQUENESS = 0.005  # share of an item's variance that the factor never explains
STARTS = 4  # besides the usual one
DECIMALS = 6  # of the fit of the factor model that are certain
# Condition number from which the information matrix counts as singular: at most 10⁴ where one
# factor is identified, 10¹⁶ where rounding alone separates the matrix from a singular one.
SINGULAR = 1e10


class UndefinedCoefficientError(ValueError):
    """These answers have no such coefficient; the text is the reason."""


@dataclass(frozen=True)
class OneFactor:
    """A model with one factor: covariances are λλ' + diag(ψ)."""

    loadings: Floats  # λ, (k,), in units of the items
    uniquenesses: Floats  # ψ, (k,), variances
    at_bound: tuple[int, ...]  # places of items whose ψ is at its lower bound (a Heywood case)


def cronbach(items: Floats) -> IntervalEstimate:
    """Return alpha with its interval, or raise UndefinedCoefficientError."""
    n, k = items.shape
    if k < 2:
        raise UndefinedCoefficientError("one item")
    if n < 2:
        raise UndefinedCoefficientError("fewer than two participants")
    sums = items.sum(axis=1)
    if is_constant(sums, float(np.abs(items).max())):
        raise UndefinedCoefficientError("no variance of the sum")
    inside = float(items.var(axis=0, ddof=1).sum())
    alpha = k / (k - 1) * (1.0 - inside / float(sums.var(ddof=1)))
    quantiles = scipy.special.fdtri(n - 1, (n - 1) * (k - 1), [UPPER, LOWER])
    low, high = (1.0 - (1.0 - alpha) * quantiles).tolist()
    return IntervalEstimate(alpha, low, high)


def mcdonald(items: Floats) -> tuple[IntervalEstimate, tuple[int, ...]]:
    """Return omega with its interval, and the places of items whose ψ is at its bound: then there
    is no interval. Raises UndefinedCoefficientError.
    """
    n, k = items.shape
    if k < 3:
        raise UndefinedCoefficientError("fewer than three items")
    if n <= k:
        raise UndefinedCoefficientError(f"{n} participants for {k} items")
    if any(is_constant(column) for column in items.T):
        raise UndefinedCoefficientError("an item without variance")
    model = one_factor(np.cov(items, rowvar=False))
    common = float(model.loadings.sum()) ** 2
    omega = common / (common + float(model.uniquenesses.sum()))
    if model.at_bound or not 0.0 < omega < 1.0:
        return IntervalEstimate(round(omega, DECIMALS)), model.at_bound
    error = _error_of_omega(model, n) / (omega * (1.0 - omega))
    logits = scipy.special.logit(omega) + np.array([-Z, Z]) * error
    low, high = np.round(scipy.special.expit(logits), DECIMALS).tolist()
    return IntervalEstimate(round(omega, DECIMALS), low, high), ()


def against_the_rest(items: Floats) -> Floats:
    """Return each item's correlation with the sum of the others, (k,); NaN without variance."""
    rest = items.sum(axis=1, keepdims=True) - items
    with np.errstate(divide="ignore", invalid="ignore"):
        own, others = items - items.mean(axis=0), rest - rest.mean(axis=0)
        size = np.sqrt((own**2).sum(axis=0) * (others**2).sum(axis=0))
        found: Floats = (own * others).sum(axis=0) / np.where(size > 0.0, size, np.nan)
    return found


def one_factor(covariances: Floats) -> OneFactor:
    """Fit the model to covariances (k, k) by maximum likelihood, minimised over ψ alone (Jöreskog,
    1967), on the scale of correlations, from several starts: few participants give local minima.
    """
    sd = np.sqrt(np.diag(covariances))
    correlations = covariances / np.outer(sd, sd)
    if np.linalg.eigvalsh(correlations)[0] < 1e-9:
        raise UndefinedCoefficientError("an item follows from the others")
    usual = (1.0 - 0.5 / len(sd)) / np.diag(np.linalg.inv(correlations))
    more = STARTS if len(sd) > 3 else 0  # three items have one solution, or infinitely many
    others = np.random.default_rng(1).uniform(LEAST_UNIQUENESS, 1.0, (more, len(sd)))
    minimize = partial(scipy.optimize.minimize, _discrepancy, method="L-BFGS-B", jac=True)
    options = {"ftol": 1e-14, "gtol": 1e-9, "maxiter": 1000}
    bounds = [(LEAST_UNIQUENESS, 1.0)] * len(sd)
    tried = [
        minimize(start, args=(correlations,), bounds=bounds, options=options)
        for start in (usual, *others)
    ]
    found = min(tried, key=lambda one: round(one.fun, 9))  # the first of equal ones
    at_bound = np.flatnonzero(found.x <= LEAST_UNIQUENESS * (1.0 + 1e-6))
    _, loadings = _factored(found.x, correlations)
    return OneFactor(loadings * sd, found.x * sd**2, tuple(at_bound.tolist()))


def _discrepancy(uniquenesses: Floats, correlations: Floats) -> tuple[float, Floats]:
    """Return the discrepancy and its gradient: Σ(θ - log θ - 1) over all but the greatest of the
    eigenvalues θ of Ψ^-½ R Ψ^-½.
    """
    values, loadings = _factored(uniquenesses, correlations)
    rest = values[:-1]
    implied = loadings**2 + uniquenesses
    gradient: Floats = (implied - np.diag(correlations)) / uniquenesses**2
    return float((rest - np.log(rest) - 1.0).sum()), gradient


def _factored(uniquenesses: Floats, correlations: Floats) -> tuple[Floats, Floats]:
    """Return the eigenvalues θ (k,) and the loadings (k,) that go with uniquenesses."""
    root = np.sqrt(uniquenesses)
    values, vectors = np.linalg.eigh(correlations / np.outer(root, root))
    found: Floats = root * vectors[:, -1] * math.sqrt(max(0.0, float(values[-1]) - 1.0))
    return values, found if found.sum() >= 0.0 else -found


def _error_of_omega(model: OneFactor, n: int) -> float:
    """Return the standard error of omega by the delta method, with the expected information on (λ,
    ψ), (2k, 2k): n/2 · tr(Σ⁻¹ ∂ᵢΣ Σ⁻¹ ∂ⱼΣ). Raises UndefinedCoefficientError if that is singular.
    """
    loadings, k = model.loadings, len(model.loadings)
    common, own = float(loadings.sum()), float(model.uniquenesses.sum())
    inverse = np.linalg.inv(np.outer(loadings, loadings) + np.diag(model.uniquenesses))
    side = inverse @ loadings
    of_loadings = 2.0 * (np.outer(side, side) + float(loadings @ side) * inverse)
    crossed = 2.0 * inverse * side[:, None]
    information = n / 2.0 * np.block([[of_loadings, crossed.T], [crossed, inverse**2]])
    size = np.sqrt(np.diag(information))
    if np.linalg.cond(information / np.outer(size, size)) > SINGULAR:  # solve may find a number
        raise UndefinedCoefficientError("one factor is not identified")
    slope = np.repeat([2.0 * common * own, -(common**2)], k) / (common**2 + own) ** 2
    return math.sqrt(float(slope @ np.linalg.solve(information, slope)))
