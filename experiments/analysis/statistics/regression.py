"""Models of proportions, counts and times, whose drives of one participant are a cluster.

- Proportions: logistic regression; counts: Poisson regression of the rate per minute. Both by
  generalized estimating equations (Liang and Zeger, 1986), working as if drives were independent,
  with covariances from the residuals of each participant, which overdispersion and zeros do not
  bias, and the correction of Mancl and DeRouen (2001) for few participants. Fitted by statsmodels.
- Times: Cox's regression (1972), in which a drive that ended before the time came is censored, with
  the covariance of Lin and Wei (1989) by participants. Times of different participants in two or
  more groups are compared by the log-rank test (Mantel, 1966).

Tests of terms are Wald's, with t and F on as many degrees of freedom as there are participants less
coefficients; those of contrasts are score tests. Coefficients are log odds ratios, log rate ratios,
and logarithms of how many times longer (a hazard ratio, the second over the first); all are
positive where the first side is greater.
"""

import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from experiments.analysis.dataset.records import Floats
from experiments.analysis.statistics.comparisons import (
    NO_VARIANCE,
    TOO_FEW,
    IntervalEstimate,
    Test,
)
from experiments.analysis.statistics.conditions import NO_TEST, ONE_CONDITION, compare
from experiments.analysis.statistics.mixed_models import coefficient, grouped, p_of
from experiments.analysis.statistics.models import (
    CannotFitError,
    Design,
    FittedModel,
    TermTest,
    check_data,
    design_of,
)

Family = Literal["proportions", "counts", "times"]
RATIO = {"proportions": "odds ratio", "counts": "rate ratio", "times": "hazard ratio"}
LOG_RANK = "log-rank χ²"
SCORE = {
    "proportions": "score F (logistic)",
    "counts": "score F (Poisson)",
    "times": "score F (Cox)",
}
WALD = {"proportions": "Wald F (logistic)", "counts": "Wald F (Poisson)", "times": "Wald F (Cox)"}
SEPARATED = "no estimate: the effects separate the outcomes completely"
NEVER = "the time came in no drive"
FIELDS = ("value", "weight")
LARGEST = 12.0  # of a coefficient: beyond it, the data separate and have no estimate


@dataclass(frozen=True)
class DriveOutcome:
    """What came of a drive of somebody: 0 or 1 of a proportion, a number of events, or seconds.
    `weight` is the minutes in which the events were counted; of a time 1 when it came, 0 when the
    drive ended before.
    """

    who: str
    value: float
    weight: float = 1.0


Sides = Mapping[str, Sequence[DriveOutcome]]


def fit_family(
    family: Family,
    outcomes: Sequence[DriveOutcome],
    design: Design,
    terms: Sequence[str],
) -> FittedModel:
    """Fit a model to the drives of participants.

    Raises:
        CannotFitError: there are too few data, no variance, columns that depend on each other, or
            effects that separate the outcomes completely (in a level, all drives succeeded).
    """
    groups, people = grouped([one.who for one in outcomes])
    values, weights = (np.array([getattr(one, name) for one in outcomes]) for name in FIELDS)
    known = values / weights if family == "counts" else values if weights.any() else weights
    check_data(known, design.columns, people)
    fitted = _cox if family == "times" else _estimating_equations
    estimates, covariance = fitted(family, values, weights, design.columns, groups)
    df = float(people - len(design.names))
    if df < 1.0:
        raise CannotFitError("too few participants for so many effects")
    if not np.isfinite(covariance).all() or np.abs(estimates).max() > LARGEST:
        raise CannotFitError(SEPARATED)
    errors = np.sqrt(np.diag(covariance))
    coefficients = [
        coefficient(name, float(value), float(error), df)
        for name, value, error in zip(design.names, estimates, errors, strict=True)
        if error > 0.0  # Cox's regression has no intercept
    ]
    by_name = {one.name: one.estimate for one in coefficients}
    tests = []
    for number, name in enumerate(terms, start=1):
        places = design.places(number)
        own = estimates[places]
        f = own @ np.linalg.solve(covariance[np.ix_(places, places)], own) / len(places)
        difference = design.difference(number, by_name[design.names[places[0]]])
        freedom = (float(len(places)), df)
        tests.append(TermTest(name, float(f), freedom, float(p_of(f, freedom)), difference))
    return FittedModel(people, len(outcomes), tuple(coefficients), tuple(tests))


def _estimating_equations(
    family: Family, values: Floats, minutes: Floats, columns: Floats, groups: Any
) -> tuple[Floats, Floats]:
    import statsmodels.api as sm  # noqa: PLC0415 - not on robots

    model = sm.GEE(
        values,
        columns,
        groups=groups,
        family=sm.families.Poisson() if family == "counts" else sm.families.Binomial(),
        exposure=minutes if family == "counts" else None,
    )
    with _separation():
        found = model.fit(cov_type="bias_reduced", maxiter=100, ctol=1e-9)
    if found is None or not found.converged:
        raise CannotFitError(SEPARATED)
    return np.asarray(found.params), np.asarray(found.cov_params())


@contextmanager
def _separation() -> Iterator[None]:
    """Say in place of warnings and errors of a fit what is wrong with the data: estimates run to
    infinity where all drives of a level have the same outcome.
    """
    try:
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except (np.linalg.LinAlgError, ValueError) as error:
        raise CannotFitError(SEPARATED) from error


def _cox(
    _family: Family, times: Floats, came: Floats, columns: Floats, groups: Any
) -> tuple[Floats, Floats]:
    """Return estimates and covariance of the logarithm of how much longer times are, an unused
    intercept first.
    """
    from statsmodels.duration.hazard_regression import PHReg  # noqa: PLC0415 - not on robots

    people, k = int(groups.max()) + 1, columns.shape[1]
    with _separation():
        found = PHReg(times, columns[:, 1:], status=came).fit(groups=groups, disp=0)
    covariance = np.zeros((k, k))
    covariance[1:, 1:] = np.asarray(found.cov_params()) * people / (people - 1.0)
    return np.concatenate(([0.0], -np.asarray(found.params))), covariance


# --- comparisons ----------------------------------------------------------------------------------


def compare_drives(family: Family, sides: Sides) -> Test:
    """Return the test of a difference between sides of drives: of proportions, with one drive of a
    participant on each side, by conditions.compare; of times of different participants by the
    log-rank test; otherwise by the score test of a model of the sides.

    A side with drives of fewer than two participants takes itself out, and the remark says so.
    """
    few = {key: len({one.who for one in side}) for key, side in sides.items()}
    told = "; ".join(f"{key}: left out, n = {n}" for key, n in few.items() if n < 2)
    kept = {key: side for key, side in sides.items() if few[key] >= 2}
    if len(kept) < 2:
        return Test(NO_TEST, 0, remark="; ".join(filter(None, (told, ONE_CONDITION))))
    people = [one.who for side in kept.values() for one in side]
    is_single = all(few[key] == len(side) for key, side in kept.items())
    is_apart = is_single and len(set(people)) == len(people)
    whole = set.intersection(*({one.who for one in side} for side in kept.values()))
    if family == "proportions" and is_single and (is_apart or whole):
        values = {key: {one.who: one.value for one in side} for key, side in kept.items()}
        test = compare(values, is_paired=not is_apart, by="proportions")
    elif family == "times" and is_apart:
        test = _log_rank(kept)
    else:
        test = _score_test(family, kept)
    remark = "; ".join(filter(None, (told, test.remark)))
    return replace(test, remark=remark)


def _score_test(family: Family, sides: Sides) -> Test:
    """Return the robust score test of sides. It needs no estimate, so that there is one where the
    sides separate the outcomes completely.

    A drive's score is its residual without any effect, times its side less the mean of all sides by
    their information; the scores of a participant are summed, and their mean is tested by
    Hotelling's T² (Guo et al., 2005, have this test with generalized estimating equations).
    """
    outcomes = [one for side in sides.values() for one in side]
    if family == "times" and not any(one.weight for one in outcomes):
        return Test(SCORE[family], len({one.who for one in outcomes}), remark=NEVER)
    rows = [{"side": key} for key, side in sides.items() for _ in side]
    design = design_of({"side": list(sides)}, ["side"], rows)
    groups, n = grouped([one.who for one in outcomes])
    summed = np.zeros((n, len(sides) - 1))
    np.add.at(summed, groups, _scores(family, outcomes, design.columns[:, 1:]))
    size = summed.shape[1]
    covariance, mean = np.atleast_2d(np.cov(summed, rowvar=False)), summed.mean(axis=0)
    if n <= size + 1 or np.linalg.matrix_rank(covariance) < size:
        return Test(SCORE[family], n, remark=NO_VARIANCE)
    f = float(mean @ np.linalg.solve(covariance, mean)) * n * (n - size) / (size * (n - 1.0))
    df = (float(size), float(n - size))
    test = Test(SCORE[family], n, f, df, float(p_of(np.array(f), df)))
    return _with_ratio(test, family, outcomes, design) if size == 1 else test


def _scores(family: Family, outcomes: Sequence[DriveOutcome], sides: Floats) -> Floats:
    """Return the scores of drives, (n, k), at no effect of their sides, (n, k)."""
    values, weights = (np.array([getattr(one, name) for one in outcomes]) for name in FIELDS)
    if family == "times":
        from statsmodels.duration.hazard_regression import PHReg  # noqa: PLC0415 - not on robots

        model = PHReg(values, sides, status=weights)
        return np.asarray(model.score_residuals(np.zeros(sides.shape[1])))
    residuals = values - weights * values.sum() / weights.sum()
    return np.asarray((sides - weights @ sides / weights.sum()) * residuals[:, None])


def _with_ratio(
    test: Test, family: Family, outcomes: Sequence[DriveOutcome], design: Design
) -> Test:
    """Return a test of two sides with the ratio between them, if that can be estimated."""
    try:
        (term,) = fit_family(family, outcomes, design, ["side"]).terms
    except CannotFitError:
        return test
    low, size, high = (
        math.exp(one) for one in (term.difference.low, term.difference.value, term.difference.high)
    )
    return replace(test, effect_name=RATIO[family], effect=IntervalEstimate(size, low, high))


def _log_rank(sides: Sides) -> Test:
    from statsmodels.duration.survfunc import survdiff  # noqa: PLC0415 - not on robots

    outcomes = [one for side in sides.values() for one in side]
    n = len(outcomes)
    values, weights = (np.array([getattr(one, name) for one in outcomes]) for name in FIELDS)
    labels = np.concatenate([np.full(len(side), at) for at, side in enumerate(sides.values())])
    if not weights.any():
        return Test(LOG_RANK, n, remark=NEVER)
    if n < 3:
        return Test(LOG_RANK, n, remark=TOO_FEW)
    try:
        chi2, p = survdiff(values, weights, labels)
    except np.linalg.LinAlgError:
        return Test(LOG_RANK, n, remark=NO_VARIANCE)
    test = Test(LOG_RANK, n, float(chi2), (len(sides) - 1.0,), float(p))
    if len(sides) > 2:
        return test
    rows = [{"side": key} for key, side in sides.items() for _ in side]
    return _with_ratio(test, "times", outcomes, design_of({"side": list(sides)}, ["side"], rows))


def median_time(side: Sequence[DriveOutcome]) -> float | None:
    """Return the median of times by Kaplan and Meier (1958); None where it did not come in half of
    the drives.
    """
    from statsmodels.duration.survfunc import SurvfuncRight  # noqa: PLC0415 - not on robots

    if not any(one.weight for one in side):
        return None
    found = SurvfuncRight([one.value for one in side], [one.weight for one in side])
    reached = found.surv_times[found.surv_prob <= 0.5 + 1e-9]
    passed = found.surv_times[found.surv_prob < 0.5 - 1e-9]
    # where exactly half are left for a while, the middle of that time, as in R
    return (
        float((reached[0] + (passed if passed.size else reached)[0]) / 2) if reached.size else None
    )
