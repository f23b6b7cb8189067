"""Models of proportions, counts and times, whose drives of one participant are a cluster.

- Proportions: logistic regression; counts: Poisson regression of the rate per minute. Both by
  generalized estimating equations (Liang and Zeger, 1986), working as if drives were independent,
  with covariances from the residuals of each participant, which overdispersion and zeros do not
  bias, and the correction of Mancl and DeRouen (2001) for few participants. Fitted by statsmodels.
- Times: Cox's regression (1972), in which a drive that ended before the time came is censored, with
  the covariance of Lin and Wei (1989) by participants. Times of different participants in two or
  more groups are compared by the log-rank test (Mantel, 1966).

Tests are robust score tests (Boos, 1992; Guo et al., 2005): the residuals of the model without an
effect, times its columns, are summed for each participant, and their mean is tested by Hotelling's
T². They need no estimate of the effect, so that there is a test where it separates the outcomes
completely. Coefficients have Wald's t with as many degrees of freedom as there are participants
less coefficients. Coefficients are log odds ratios, log rate ratios, and logarithms of how many
times longer (a hazard ratio, the second over the first); all are positive where the first side is
greater.
"""

import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from experiments.analysis.statistics.comparisons import (
    NO_VARIANCE,
    ROUNDING,
    TOO_FEW,
    IntervalEstimate,
    Test,
)
from experiments.analysis.statistics.conditions import NO_TEST, ONE_CONDITION, compare
from experiments.analysis.statistics.mixed_models import coefficient, grouped, p_of
from experiments.analysis.statistics.models import (
    CannotFitError,
    Coefficient,
    Design,
    FittedModel,
    TermTest,
    check_data,
    design_of,
)
from experiments.dataset.columns import Floats

Family = Literal["proportions", "counts", "times"]
RATIO = {"proportions": "odds ratio", "counts": "rate ratio", "times": "hazard ratio"}
LOG_RANK = "log-rank χ²"
SCORE = {
    "proportions": "score F (logistic)",
    "counts": "score F (Poisson)",
    "times": "score F (Cox)",
}
SEPARATED = "no estimate: the effects separate the outcomes completely"
NEVER = "the time came in no drive"
SEPARATING = 1e-6  # information of a drive, of the largest: the model predicts its outcome surely
FIELDS = ("value", "weight")
LARGEST = 12.0  # of a coefficient or its error: beyond it, the data separate


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
    *,
    with_coefficients: bool = True,
) -> FittedModel:
    """Fit a model to the drives of participants. There are tests, but no coefficients, where the
    effects separate the outcomes completely (in a level, all drives succeeded), and none
    `with_coefficients` false, for simulations.

    Raises:
        CannotFitError: there are too few data, no variance, or columns that depend on each other.
    """
    groups, people = grouped([one.who for one in outcomes])
    values, weights = (np.array([getattr(one, name) for one in outcomes]) for name in FIELDS)
    known = values / weights if family == "counts" else values if weights.any() else weights
    check_data(known, design.columns, people)
    if people <= len(design.names):
        raise CannotFitError("too few participants for so many effects")
    coefficients: tuple[Coefficient, ...] = ()
    remark = ""
    if with_coefficients:
        try:
            coefficients = _coefficients(family, values, weights, design, groups)
        except CannotFitError as error:
            remark = str(error)
    by_name = {one.name: one.estimate for one in coefficients}
    tests = []
    for number, name in enumerate(terms, start=1):
        places = design.places(number)
        f, df = _hotelling(_scores(family, values, weights, design.columns, places), groups, people)
        half = by_name.get(design.names[places[0]], IntervalEstimate())
        difference = design.difference(number, half)
        tests.append(TermTest(name, f, df, float(p_of(np.array(f), df)), difference))
    return FittedModel(people, len(outcomes), coefficients, tuple(tests), remark=remark)


def _coefficients(
    family: Family, values: Floats, weights: Floats, design: Design, groups: Any
) -> tuple[Coefficient, ...]:
    fitted = _cox if family == "times" else _estimating_equations
    estimates, covariance = fitted(family, values, weights, design.columns, groups)
    with np.errstate(invalid="ignore"):
        errors = np.sqrt(np.diag(covariance))
    if not (np.abs(estimates).max() <= LARGEST and errors.max() <= LARGEST):  # also of NaN
        raise CannotFitError(SEPARATED)
    df = float(groups.max() + 1 - len(design.names))
    return tuple(
        coefficient(name, float(value), float(error), df)
        for name, value, error in zip(design.names, estimates, errors, strict=True)
        if error > 0.0  # Cox's regression has no intercept
    )


def _scores(
    family: Family, values: Floats, weights: Floats, columns: Floats, places: Sequence[int]
) -> Floats:
    """Return the scores of drives, (n, q), for columns at some places, where their coefficients are
    0: residuals of the model without them, times what of them the other columns do not explain; NaN
    where the other columns separate outcomes, as what they explain is then anything.
    """
    others = [at for at in range(columns.shape[1]) if at not in places]
    with _separation():
        if family == "times":
            return _scores_of_times(values, weights, columns[:, 1:], [at - 1 for at in places])
        import statsmodels.api as sm  # noqa: PLC0415 - not on robots

        of_family = sm.families.Poisson() if family == "counts" else sm.families.Binomial()
        exposure = weights if family == "counts" else None
        rest, own = columns[:, others], columns[:, list(places)]
        mean = sm.GLM(values, rest, family=of_family, exposure=exposure).fit().fittedvalues
        information = mean if family == "counts" else mean * (1.0 - mean)
        if information.min() < SEPARATING * information.max():
            return np.full_like(own, math.nan)
        weighted = rest.T * information
        explained = rest @ np.linalg.solve(weighted @ rest, weighted @ own)
        return np.asarray((own - explained) * (values - mean)[:, None])


def _scores_of_times(times: Floats, came: Floats, columns: Floats, places: Sequence[int]) -> Floats:
    from statsmodels.duration.hazard_regression import PHReg  # noqa: PLC0415 - not on robots

    others = [at for at in range(columns.shape[1]) if at not in places]
    at_null = np.zeros(columns.shape[1])
    if others:
        at_null[others] = PHReg(times, columns[:, others], status=came).fit(disp=0).params
    model = PHReg(times, columns, status=came)
    own, scores = list(places), _residuals(model, at_null)
    if not others:
        return np.asarray(scores[:, own])
    information = model.hessian(at_null)
    explained = np.linalg.solve(
        information[np.ix_(others, others)], information[np.ix_(others, own)]
    )
    return np.asarray(scores[:, own] - scores[:, others] @ explained)


def _residuals(model: Any, estimates: Floats) -> Floats:
    """Return the score residuals of drives, (n, k); one that ended before anybody's time came was
    never at risk, and has 0 where statsmodels has NaN.
    """
    return np.asarray(np.nan_to_num(model.score_residuals(estimates)))


def _by_participant(scores: Floats, groups: Any, people: int) -> Floats:
    summed = np.zeros((people, scores.shape[1]))
    np.add.at(summed, groups, scores)
    return summed


def _hotelling(scores: Floats, groups: Any, people: int) -> tuple[float, tuple[float, float]]:
    """Return F that the mean of the participants' summed scores is 0, and its degrees of freedom;
    NaN of scores that are NaN.

    Raises:
        CannotFitError: they do not vary.
    """
    if np.isnan(scores).any():
        return math.nan, (math.nan, math.nan)
    size = scores.shape[1]
    summed = _by_participant(scores, groups, people)
    summed[np.abs(summed) <= ROUNDING * np.abs(scores).max()] = 0.0
    covariance, mean = np.atleast_2d(np.cov(summed, rowvar=False)), summed.mean(axis=0)
    is_known = people > size + 1 and np.isfinite(covariance).all()
    if not is_known or np.linalg.matrix_rank(covariance) < size:
        raise CannotFitError(NO_VARIANCE)
    factor = people * (people - size) / (size * (people - 1.0))
    f = float(mean @ np.linalg.solve(covariance, mean)) * factor
    return f, (float(size), float(people - size))


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
    model = PHReg(times, columns[:, 1:], status=came)
    with _separation():
        estimates = np.asarray(model.fit(disp=0).params)
        inverse = np.linalg.inv(model.hessian(estimates))
    if not -inverse.diagonal().min() <= LARGEST**2:  # several may share what runs to infinity
        raise CannotFitError(SEPARATED)
    # statsmodels has no covariance by groups where a drive was never at risk
    summed = _by_participant(_residuals(model, estimates), groups, people)
    covariance = np.zeros((k, k))
    covariance[1:, 1:] = inverse @ summed.T @ summed @ inverse * people / (people - 1.0)
    return np.concatenate(([0.0], -estimates)), covariance


# --- comparisons ----------------------------------------------------------------------------------


def compare_drives(family: Family, sides: Sides, *, with_ratio: bool = True) -> Test:
    """Return the test of a difference between sides of drives: of proportions, with one drive of a
    participant on each side, by conditions.compare; of times of different participants by the
    log-rank test; otherwise by the score test of a model of the sides.

    A side with drives of fewer than two participants takes itself out, and the remark says so. The
    ratio of two sides takes most of the time; simulations leave it out.
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
        test = _log_rank(kept, with_ratio=with_ratio)
    else:
        test = _score_test(family, kept, with_ratio=with_ratio)
    remark = "; ".join(filter(None, (told, test.remark)))
    return replace(test, remark=remark)


def _score_test(family: Family, sides: Sides, *, with_ratio: bool) -> Test:
    outcomes = [one for side in sides.values() for one in side]
    n = len({one.who for one in outcomes})
    if family == "times" and not any(one.weight for one in outcomes):
        return Test(SCORE[family], n, remark=NEVER)
    rows = [{"side": key} for key, side in sides.items() for _ in side]
    design = design_of({"side": list(sides)}, ["side"], rows)
    is_sized = with_ratio and len(sides) == 2
    try:
        found = fit_family(family, outcomes, design, ["side"], with_coefficients=is_sized)
    except CannotFitError as error:
        return Test(SCORE[family], n, remark=str(error))
    (term,) = found.terms
    return _with_ratio(Test(SCORE[family], n, term.f, term.df, term.p), family, term)


def _with_ratio(test: Test, family: Family, term: TermTest) -> Test:
    """Return a test of two sides with the ratio between them, if it has an estimate."""
    size = term.difference
    if not math.isfinite(size.value):
        return test
    ratio = IntervalEstimate(*(math.exp(one) for one in (size.value, size.low, size.high)))
    return replace(test, effect_name=RATIO[family], effect=ratio)


def _log_rank(sides: Sides, *, with_ratio: bool) -> Test:
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
    if len(sides) > 2 or not with_ratio:
        return test
    rows = [{"side": key} for key, side in sides.items() for _ in side]
    design = design_of({"side": list(sides)}, ["side"], rows)
    (term,) = fit_family("times", outcomes, design, ["side"]).terms
    return _with_ratio(test, "times", term)


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
