"""Models of proportions, counts and times; the drives of one participant are a cluster.

- Proportions: logistic regression; counts: Poisson regression of the rate per minute. Both by
  generalized estimating equations, working as if drives were independent; covariances from the
  residuals of each participant are not biased by overdispersion and zeros.
- Times: Cox's regression, in which a drive that ended before the time came is censored; times of
  different participants in two or more groups are compared by the log-rank test.

Tests are robust score tests: the residuals of the model without an effect, times its columns, are
summed for each participant, and their mean is tested by Hotelling's T². They need no estimate of
the effect, so that there is a test where it separates the outcomes completely. Coefficients have
Wald's t, with participants less coefficients as its degrees of freedom; they are log odds ratios,
log rate ratios, and logarithms of how many times longer (a hazard ratio, the second over the
first), all positive where the first side is greater. docs/explanation/statistics.md has the
sources.
"""

import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from experiments.analysis.statistics import models
from experiments.analysis.statistics.comparisons import (
    NO_VARIANCE,
    ROUNDING,
    UNKNOWN,
    IntervalEstimate,
    Test,
)
from experiments.analysis.statistics.conditions import NO_TEST, ONE_CONDITION, compare
from experiments.analysis.statistics.mixed_models import coefficient, grouped, p_of
from experiments.dataset.columns import Floats

Family = Literal["proportions", "counts", "times"]
RATIO = {"proportions": "odds ratio", "counts": "rate ratio", "times": "hazard ratio"}
LOG_RANK = "log-rank χ²"
_MODELS = {"proportions": "logistic", "counts": "Poisson", "times": "Cox"}
SCORE = {family: f"score F ({model})" for family, model in _MODELS.items()}
SEPARATED = "no estimate: the effects separate the outcomes completely"
NEVER = "the time came in no drive"
SEPARATING = 1e-6  # information of a drive, of the largest: the model predicts its outcome surely
LARGEST = 12.0  # of a coefficient or its error: beyond it, the data separate


@dataclass(frozen=True)
class DriveOutcome:
    """The outcome of a participant's drive: 0 or 1 of a proportion, a number of events, or seconds.
    `weight` is, of a count, the minutes in which the events were counted; of a time, 1 if it came
    and 0 if the drive ended before.
    """

    who: str
    value: float
    weight: float = 1.0


Sides = Mapping[str, Sequence[DriveOutcome]]


def _arrays(outcomes: Sequence[DriveOutcome]) -> tuple[Floats, Floats]:
    return np.array([one.value for one in outcomes]), np.array([one.weight for one in outcomes])


def fit_family(
    family: Family,
    outcomes: Sequence[DriveOutcome],
    design: models.Design,
    terms: Sequence[str],
    *,
    with_coefficients: bool = True,
) -> models.FittedModel:
    """Fit a model to the drives of participants. Where the effects separate the outcomes completely
    (in a level, all drives succeeded), there are tests but no coefficients. Simulations need tests
    only, and leave out the coefficients. Raises CannotFitError with too few data, without variance,
    or where columns depend on each other.
    """
    groups, people = grouped([one.who for one in outcomes])
    values, weights = _arrays(outcomes)
    known = values / weights if family == "counts" else values if weights.any() else weights
    models.check_data(known, design.columns, people)
    if people <= len(design.names):
        raise models.CannotFitError("too few participants for so many effects")
    coefficients: tuple[models.Coefficient, ...] = ()
    remark = ""
    if with_coefficients:
        try:
            coefficients = _coefficients(family, values, weights, design, groups)
        except models.CannotFitError as error:
            remark = str(error)
    estimates = {one.name: one.estimate for one in coefficients}
    tests = []
    for number, name in enumerate(terms, start=1):
        places = design.places(number)
        f, df = _hotelling(_scores(family, values, weights, design.columns, places), groups, people)
        half = estimates.get(design.names[places[0]], UNKNOWN)
        difference = design.difference(number, half)
        tests.append(models.TermTest(name, f, df, float(p_of(np.array(f), df)), difference))
    return models.FittedModel(people, len(outcomes), coefficients, tuple(tests), remark=remark)


@contextmanager
def _separation() -> Iterator[None]:
    """Replace warnings and errors of a fit by the reason: where all drives of a level have the same
    outcome, estimates run to infinity, which the callers see by their size.
    """
    # Imported before warnings are ignored: its import turns those of convergence on.
    import statsmodels.tools.sm_exceptions  # noqa: F401, PLC0415 - not on robots

    try:
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except (np.linalg.LinAlgError, ValueError) as error:
        raise models.CannotFitError(SEPARATED) from error


def _of_family(family: Family, minutes: Floats) -> dict[str, Any]:
    """Return what statsmodels takes of a family: its distribution, and the time of its counts."""
    import statsmodels.api as sm  # noqa: PLC0415 - not on robots

    if family == "counts":
        return {"family": sm.families.Poisson(), "exposure": minutes}
    return {"family": sm.families.Binomial()}


# --- coefficients ---------------------------------------------------------------------------------


def _coefficients(
    family: Family, values: Floats, weights: Floats, design: models.Design, groups: Any
) -> tuple[models.Coefficient, ...]:
    names, columns = design.names, design.columns
    with _separation():
        if family == "times":
            names = names[1:]  # Cox's regression has no intercept
            estimates, covariance = _cox(values, weights, columns[:, 1:], groups)
        else:
            import statsmodels.api as sm  # noqa: PLC0415 - not on robots

            model = sm.GEE(values, columns, groups=groups, **_of_family(family, weights))
            found = model.fit(cov_type="bias_reduced", maxiter=100, ctol=1e-9)
            if found is None or not found.converged:
                raise models.CannotFitError(SEPARATED)
            estimates, covariance = np.asarray(found.params), np.asarray(found.cov_params())
        errors = np.sqrt(np.diag(covariance))
    if not (np.abs(estimates).max() <= LARGEST and errors.max() <= LARGEST):  # also of NaN
        raise models.CannotFitError(SEPARATED)
    each = zip(names, estimates.tolist(), errors.tolist(), strict=True)
    df = float(groups.max() + 1 - len(design.names))
    return tuple(coefficient(name, value, error, df) for name, value, error in each)


def _cox(times: Floats, came: Floats, columns: Floats, groups: Any) -> tuple[Floats, Floats]:
    """Return estimates (k,) of the logarithm of how much longer times are, and their covariance
    (k, k), robust by participant: statsmodels has none where a drive was never at risk.
    """
    from statsmodels.duration.hazard_regression import PHReg  # noqa: PLC0415 - not on robots

    people = int(groups.max()) + 1
    model = PHReg(times, columns, status=came)
    estimates = np.asarray(model.fit(disp=0).params)
    inverse = np.linalg.inv(model.hessian(estimates))
    if not -inverse.diagonal().min() <= LARGEST**2:  # several may share an infinite estimate
        raise models.CannotFitError(SEPARATED)
    summed = _by_participant(_residuals(model, estimates), groups, people)
    covariance = inverse @ summed.T @ summed @ inverse * people / (people - 1.0)
    return -estimates, covariance


# --- score tests ----------------------------------------------------------------------------------


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

        rest, own = columns[:, others], columns[:, list(places)]
        mean = sm.GLM(values, rest, **_of_family(family, weights)).fit().fittedvalues
        information = mean if family == "counts" else mean * (1.0 - mean)
        if information.min() < SEPARATING * information.max():
            return np.full_like(own, math.nan)
        weighted = rest.T * information
        explained = rest @ np.linalg.solve(weighted @ rest, weighted @ own)
        return np.asarray((own - explained) * (values - mean)[:, None])


def _scores_of_times(times: Floats, came: Floats, columns: Floats, own: Sequence[int]) -> Floats:
    from statsmodels.duration.hazard_regression import PHReg  # noqa: PLC0415 - not on robots

    others = [at for at in range(columns.shape[1]) if at not in own]
    at_null = np.zeros(columns.shape[1])
    if others:
        at_null[others] = PHReg(times, columns[:, others], status=came).fit(disp=0).params
    model = PHReg(times, columns, status=came)
    scores = _residuals(model, at_null)
    if not others:
        return np.asarray(scores[:, own])
    information = model.hessian(at_null)
    within, across = np.ix_(others, others), np.ix_(others, own)
    errors = -np.linalg.inv(information[within]).diagonal()
    if not (np.abs(at_null).max() <= LARGEST and errors.max() <= LARGEST**2):
        return np.full((len(times), len(own)), math.nan)
    explained = np.linalg.solve(information[within], information[across])
    return np.asarray(scores[:, own] - scores[:, others] @ explained)


def _residuals(model: Any, estimates: Floats) -> Floats:
    """Return the score residuals of drives, (n, k); one that ended before the first time came was
    never at risk, and has 0 where statsmodels has NaN.
    """
    return np.asarray(np.nan_to_num(model.score_residuals(estimates)))


def _by_participant(scores: Floats, groups: Any, people: int) -> Floats:
    summed = np.zeros((people, scores.shape[1]))
    np.add.at(summed, groups, scores)
    return summed


def _hotelling(scores: Floats, groups: Any, people: int) -> tuple[float, tuple[float, float]]:
    """Return F that the mean of the participants' summed scores is 0, and its degrees of freedom;
    NaN of scores that are NaN. Raises CannotFitError where they do not vary.
    """
    if np.isnan(scores).any():
        return math.nan, (math.nan, math.nan)
    size = scores.shape[1]
    summed = _by_participant(scores, groups, people)
    summed[np.abs(summed) <= ROUNDING * np.abs(scores).max()] = 0.0
    covariance, mean = np.atleast_2d(np.cov(summed, rowvar=False)), summed.mean(axis=0)
    is_known = people > size + 1 and np.isfinite(covariance).all()
    if not is_known or np.linalg.matrix_rank(covariance) < size:
        raise models.CannotFitError(NO_VARIANCE)
    factor = people * (people - size) / (size * (people - 1.0))
    f = float(mean @ np.linalg.solve(covariance, mean)) * factor
    return f, (float(size), float(people - size))


# --- comparisons ----------------------------------------------------------------------------------


def compare_drives(
    family: Family,
    sides: Sides,
    *,
    is_paired: bool | None,
    is_single: bool = True,
    with_ratio: bool = True,
) -> Test:
    """Return the test of a difference between sides of drives, which the design chooses
    (factors.SideLayout): with one drive of a participant on each side, of proportions by
    conditions.compare, and of times of different participants by the log-rank test; otherwise by
    the score test of a model of the sides.

    A side with drives of fewer than two participants is left out, which the remark says. The ratio
    of two sides takes most of the time; simulations leave it out.
    """
    codes = {key: {one.who for one in side} for key, side in sides.items()}
    kept = {key: side for key, side in sides.items() if len(codes[key]) >= 2}
    remarks = [f"{key}: left out, n = {len(codes[key])}" for key in sides if key not in kept]
    if len(kept) < 2:
        test = Test(NO_TEST, 0, remark=ONE_CONDITION)
    elif family == "proportions" and is_single and is_paired is not None:
        values = {key: {one.who: one.value for one in side} for key, side in kept.items()}
        test = compare(values, is_paired=is_paired, by="proportions")
    elif family == "times" and is_single and is_paired is False:
        test = _log_rank(kept, with_ratio=with_ratio)
    else:
        test = _score_test(family, kept, with_ratio=with_ratio)
    return replace(test, remark="; ".join(filter(None, (*remarks, test.remark))))


def _score_test(family: Family, sides: Sides, *, with_ratio: bool) -> Test:
    """Return the score test of a model of sides, with the ratio of two if it has an estimate."""
    outcomes = [one for side in sides.values() for one in side]
    name, n = SCORE[family], len({one.who for one in outcomes})
    if family == "times" and not any(one.weight for one in outcomes):
        return Test(name, n, remark=NEVER)
    rows = [{"side": key} for key, side in sides.items() for _ in side]
    design = models.design_of({"side": list(sides)}, ["side"], rows)
    is_sized = with_ratio and len(sides) == 2
    try:
        found = fit_family(family, outcomes, design, ["side"], with_coefficients=is_sized)
    except models.CannotFitError as error:
        return Test(name, n, remark=str(error))
    (term,) = found.terms
    test, size = Test(name, n, term.f, term.df, term.p), term.difference
    if not math.isfinite(size.value):
        return test
    ratio = IntervalEstimate(*map(math.exp, (size.value, size.low, size.high)))
    return replace(test, effect_name=RATIO[family], effect=ratio)


def _log_rank(sides: Sides, *, with_ratio: bool) -> Test:
    from statsmodels.duration.survfunc import survdiff  # noqa: PLC0415 - not on robots

    values, weights = _arrays([one for side in sides.values() for one in side])
    labels = [key for key, side in sides.items() for _ in side]
    if not weights.any():
        return Test(LOG_RANK, len(values), remark=NEVER)
    try:
        chi2, p = map(float, survdiff(values, weights, labels))
    except np.linalg.LinAlgError:
        return Test(LOG_RANK, len(values), remark=NO_VARIANCE)
    test = Test(LOG_RANK, len(values), chi2, (len(sides) - 1.0,), p)
    if len(sides) > 2 or not with_ratio:
        return test
    sized = _score_test("times", sides, with_ratio=True)
    return replace(test, effect_name=sized.effect_name, effect=sized.effect)


def median_time(side: Sequence[DriveOutcome]) -> float | None:
    """Return the median of times by Kaplan and Meier (1958); None if it came in less than half of
    the drives. Where exactly half are left for a while, it is the middle of that time, as in R.
    """
    from statsmodels.duration.survfunc import SurvfuncRight  # noqa: PLC0415 - not on robots

    if not any(one.weight for one in side):
        return None
    found = SurvfuncRight(*_arrays(side))
    reached = found.surv_times[found.surv_prob <= 0.5 + 1e-9]
    passed = found.surv_times[found.surv_prob < 0.5 - 1e-9]
    if not reached.size:
        return None
    return float((reached[0] + (passed if passed.size else reached)[0]) / 2)
