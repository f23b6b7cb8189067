"""A table for each declared analysis, and one for the coefficients of each model.

In tests of means and ranks, and in mixed models, a participant has one value of a measure in each
condition: the mean over their sessions or responses. Proportions, counts and times are of each
session.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, cast

import numpy as np

from experiments.analysis.metrics.definitions import CENSORED, KINDS, OF_COMPLETED, PER_MINUTE
from experiments.analysis.metrics.sessions import Measured
from experiments.analysis.statistics import conditions, models, regression
from experiments.analysis.statistics.comparisons import Test, holm
from experiments.analysis.statistics.conditions import compare
from experiments.analysis.statistics.mixed_models import fit
from experiments.analysis.tables import comparisons, drive_outcomes
from experiments.analysis.tables.comparisons import Compared
from experiments.analysis.tables.measures import StudyMeasures
from experiments.analysis.tables.scored_responses import RULES
from experiments.analysis.tables.table import Cells, Table, TableCell, number, probability
from experiments.dataset.records import Dataset
from experiments.definition.analyses import FAMILIES, DeclaredAnalysis
from experiments.definition.factors import layout_of
from experiments.definition.plan import EXPLORATORY, deciding_hypotheses, is_confirmatory
from experiments.definition.schema import StudyDefinition
from surveys.documents import spoken

PLANNED = "Plan"  # the column that names the hypotheses of a row; only in a study with hypotheses
COEFFICIENTS = ("Measure", "Coefficient", "Estimate", "from", "to", "SE", "t", "df", "p")
SIDES = ("first", "second")
TESTS = {"mixed": conditions.WALD, **regression.SCORE}
MODELS = {
    "mixed": "Linear mixed model with an intercept for each participant, by REML. Tests: Wald, by"
    " the residuals of participants (CR2), with the degrees of freedom of Pustejovsky and Tipton"
    " (2018): they hold for any covariance of a participant's values.",
    "proportions": "Logistic regression by generalized estimating equations; difference: log odds.",
    "counts": "Poisson regression of the rate per minute by generalized estimating equations;"
    " difference: log rate.",
    "times": "Cox regression of times that are censored at the end of a session; difference: log"
    " hazard of the second less that of the first, above 0 where times of the first are longer.",
}
CLUSTERED = (
    "Effects: robust score tests by the residuals of participants. Coefficients: Wald, with"
    " participants less coefficients as the degrees of freedom of t."
)
IN_SUM_CODING = (
    "Effects are tested in sum coding: that of a factor is its average over the levels of the"
    " others. Difference, of a factor with two levels: first less second level. Covariates are in"
    " no family."
)
SPREADS = (
    "from, to: 95 % confidence interval. SD: between participants, and of the residuals; ICC:"
    " intraclass correlation."
)
CODED = {
    "treatment": "Coefficients: treatment coding, against the first level.",
    "sum": "Coefficients: sum coding, against the mean of all levels.",
}


def declared(dataset: Dataset, measured: Sequence[Measured]) -> tuple[Table, ...]:
    data = StudyMeasures(dataset, measured)
    return tuple(
        table
        for one in dataset.study.analyses
        for table in (_modelled(one, data) if one.is_model else (_compared(one, data),))
    )


def name_of(one: DeclaredAnalysis) -> str:
    return f"analysis-{one.key.replace('_', '-')}"


def _title(one: DeclaredAnalysis, data: StudyMeasures) -> str:
    return data.dataset.say(one.title).removesuffix(".")


def _plan_head(study: StudyDefinition) -> tuple[str, ...]:
    return (PLANNED,) if is_confirmatory(study.plan) else ()


def _planned(
    one: DeclaredAnalysis, study: StudyDefinition, measure: str, **which: Any
) -> tuple[str, ...]:
    """Return the cell that names the hypotheses of a test, by its contrast or effect; none in a
    study without hypotheses.
    """
    if not is_confirmatory(study.plan):
        return ()
    found = deciding_hypotheses(study.plan, one, measure, **which)
    keys = ", ".join(it.key for it in found)
    is_post_hoc = "contrast" in which and not one.contrasts
    return (f"post hoc of {keys}" if found and is_post_hoc else keys or EXPLORATORY,)


# --- contrasts, and several conditions ------------------------------------------------------------


def _compared(one: DeclaredAnalysis, data: StudyMeasures) -> Table:
    study = data.dataset.study
    named = [
        (measure, place, *contrast)
        for measure in one.measures
        for place, contrast in enumerate(contrasts_of(study, one, data.dataset.language), start=1)
    ]
    found = [
        _test_sides(one, data, measure, dict(zip(SIDES, sides, strict=True)))
        for measure, _, _, *sides in named
    ]
    corrected, members = comparisons.corrected_for(found)
    rows = [] if one.contrasts else list(_omnibus(one, data))
    for (measure, place, title, *_), (test, groups), p in zip(named, found, corrected, strict=True):
        plan = _planned(one, study, measure, contrast=place)
        rows.append((measure, *comparisons.compared(title, groups, test, p), *plan))
    notes = (
        "Declared in the study's definition, which is frozen when the study is published."
        + ("" if one.contrasts else " all: every condition at once, corrected among themselves."),
        f"p (Holm): {members} different tests of contrasts are one family.",
        RULES[study.analysis.counts],
        *_about_metrics(one),
        *comparisons.READ_AS,
        "r: rank-biserial correlation; ε²: epsilon squared. Difference of ranks: Hodges-Lehmann.",
    )
    head = ("Measure", "Contrast", *comparisons.head_of(SIDES), *_plan_head(study))
    return Table.of(name_of(one), f"{_title(one, data)}.", head, rows, notes)


def _about_metrics(one: DeclaredAnalysis) -> Iterator[str]:
    if one.test == "times":
        yield drive_outcomes.CENSORED_AT_END
    if one.test in {"times", "proportions"}:
        yield drive_outcomes.UNMOVED
        if not one.is_model:
            yield drive_outcomes.FIRST
        return
    if CENSORED.intersection(one.measures):
        yield drive_outcomes.ONLY_KNOWN
    if (PER_MINUTE | OF_COMPLETED).intersection(one.measures):
        yield drive_outcomes.RATES


def _test_sides(
    one: DeclaredAnalysis, data: StudyMeasures, measure: str, sides: Mapping[str, Sequence[str]]
) -> Compared:
    """Return the test of a measure between sides, of some conditions each, and their groups."""
    if why := data.unknown(one.test, measure):
        return Test(conditions.NO_TEST, 0, remark=why), [comparisons.ComparedSide({})] * len(sides)
    found = {name: data.side(one.test, measure, keys) for name, keys in sides.items()}
    groups = [group for _, group in found.values()]
    layout = layout_of(data.dataset.study, sides.values())
    if one.test in FAMILIES:
        drives = {name: own for name, (own, _) in found.items()}
        return regression.compare_drives(KINDS[measure], drives, **layout._asdict()), groups
    values, by = {name: group.values for name, (_, group) in found.items()}, one.test
    return compare(values, is_paired=layout.is_paired, by=cast("conditions.Compared", by)), groups


def _omnibus(one: DeclaredAnalysis, data: StudyMeasures) -> Iterator[Cells]:
    sides = {key: (key,) for key in conditions_of(data.dataset.study, one)}
    found = [_test_sides(one, data, measure, sides) for measure in one.measures]
    corrected, _ = comparisons.corrected_for(found)
    blank = [""] * (len(comparisons.head_of(SIDES)) - len(comparisons.TESTED))
    for measure, (test, _), p in zip(one.measures, found, corrected, strict=True):
        plan = _planned(one, data.dataset.study, measure)
        yield measure, "all", *blank, *comparisons.tested(test, p), *plan


def conditions_of(study: StudyDefinition, one: DeclaredAnalysis) -> tuple[str, ...]:
    return one.conditions or tuple(condition.key for condition in study.conditions)


def contrasts_of(
    study: StudyDefinition, one: DeclaredAnalysis, language: str
) -> list[tuple[str, tuple[str, ...], tuple[str, ...]]]:
    if one.contrasts:
        return [(spoken(it.title, language), it.first, it.second) for it in one.contrasts]
    pairs = combinations(conditions_of(study, one), 2) if one.post_hoc else ()
    return [(f"{a} − {b}", (a,), (b,)) for a, b in pairs]


# --- models ---------------------------------------------------------------------------------------


def _modelled(one: DeclaredAnalysis, data: StudyMeasures) -> tuple[Table, Table]:
    study = data.dataset.study
    fits = {measure: _model(one, data, measure) for measure in one.measures}
    fitted = {key: model for key, model in fits.items() if isinstance(model, models.FittedModel)}
    n_effects = len(one.effects)  # a model's terms are its effects, then its covariates
    ps = [test.p for model in fitted.values() for test in model.terms[:n_effects]]
    corrected = iter(holm(ps))
    head = (
        *("Measure", "Effect", "Participants", "Observations", "Test", "Statistic", "df", "df 2"),
        *("p", "p (Holm)", *comparisons.DIFFERENCE, comparisons.REMARK),
    )
    rows: list[Cells] = []
    for measure, model in fits.items():
        if isinstance(model, str):
            blank = [""] * (len(head) - 2)
            rows.append((measure, *blank, model, *_planned(one, study, measure)))
            continue
        for at, test in enumerate(model.terms):
            p: TableCell | str = ""
            plan = tuple(EXPLORATORY for _ in _plan_head(study))
            if at < n_effects:
                p = probability(next(corrected))
                plan = _planned(one, study, measure, effect=test.name)
            named = (measure, test.name, model.participants, model.observations, TESTS[one.test])
            numbers = (number(test.f, 2), number(test.df[0], 0), number(test.df[1], 1))
            tested = (*numbers, probability(test.p), p, *comparisons.estimated(test.difference, 3))
            rows.append((*named, *tested, model.remark, *plan))
    about = (MODELS[one.test], *(() if one.test == "mixed" else (CLUSTERED,)))
    notes = (*about, IN_SUM_CODING, comparisons.family(len(ps)), *_about_metrics(one))
    name, title = name_of(one), _title(one, data)
    effects = Table.of(name, f"{title}.", (*head, *_plan_head(study)), rows, notes)
    estimates = (row for key, model in fitted.items() for row in _coefficients(key, model))
    name, title = f"{name}-coefficients", f"{title}: coefficients."
    about = (CODED[one.coding], *about, SPREADS)
    return effects, Table.of(name, title, COEFFICIENTS, estimates, about)


def _coefficients(measure: str, model: models.FittedModel) -> Iterator[Cells]:
    for it in model.coefficients:
        estimate = (*comparisons.estimated(it.estimate, 3), number(it.error, 3))
        yield measure, it.name, *estimate, number(it.t, 2), number(it.df, 1), probability(it.p)
    for name, value in model.spreads:
        yield measure, name, number(value, 3), *[""] * 6


def _model(one: DeclaredAnalysis, data: StudyMeasures, measure: str) -> models.FittedModel | str:
    """Return the model of a measure, or why there is none. Its terms are in sum coding, its
    coefficients in the declared one.
    """
    if why := data.unknown(one.test, measure):
        return why
    try:
        own = _observations(one, data, measure)
        found = own.fit(one, "sum")
        if one.coding != "sum":
            found = replace(found, coefficients=own.fit(one, one.coding).coefficients)
    except models.CannotFitError as error:
        return str(error)
    return replace(found, remark="; ".join(filter(None, (found.remark, own.remark))))


@dataclass(frozen=True)
class ModelData:
    observed: Sequence[regression.DriveOutcome]
    rows: Sequence[models.Row]
    levels: Mapping[str, Sequence[str]]
    remark: str

    def fit(self, one: DeclaredAnalysis, coding: models.Coding) -> models.FittedModel:
        terms = (*one.effects, *one.covariates)
        design = models.design_of(self.levels, terms, self.rows, coding)
        if one.test != "mixed":
            family = cast("regression.Family", one.test)
            return regression.fit_family(family, self.observed, design, terms)
        values = np.array([one.value for one in self.observed])
        return fit(values, design, terms, [one.who for one in self.observed])


def _observations(one: DeclaredAnalysis, data: StudyMeasures, measure: str) -> ModelData:
    """Return the observations of a model; participants whose covariates are unknown have none."""
    orders = {person.id: person.cell for person in data.dataset.participants}
    covariates = {name: data.covariate(name) for name in one.covariates}
    observed: list[regression.DriveOutcome] = []
    rows: list[dict[str, str | float]] = []
    lacking: set[str] = set()
    for condition in data.dataset.study.conditions:
        if one.conditions and condition.key not in one.conditions:
            continue
        for drive in data.drives(one.test, measure, condition.key):
            known = ((name, own) for name, (own, _) in covariates.items() if drive.who in own)
            given = {name: own[drive.who] for name, own in known}
            if len(given) < len(covariates):
                lacking.add(drive.who)
                continue
            order = orders.get(drive.who, "")
            places = order.split("-")
            period = places.index(condition.key) + 1 if condition.key in places else 0
            own = {"condition": condition.key, "order": order, "period": str(period)}
            observed.append(drive)
            rows.append({**condition.levels, **own, **given})
    if not observed:
        raise models.CannotFitError("fewer than three participants")
    levels = levels_of(data.dataset.study, rows)
    levels |= {key: own for key, (_, own) in covariates.items()}
    remark = f"participants without a covariate: {len(lacking)}" if lacking else ""
    return ModelData(observed, rows, levels, remark)


def levels_of(study: StudyDefinition, rows: Sequence[models.Row]) -> dict[str, Sequence[str]]:
    """Return the levels of every factor that a model may name: of the study's own, those that it
    declares and that have data.
    """
    levels = {factor.key: [level.key for level in factor.levels] for factor in study.factors}
    levels["condition"] = [condition.key for condition in study.conditions]
    for name in ("period", "order"):
        levels[name] = sorted({str(row[name]) for row in rows})
    given = {name: {row[name] for row in rows if name in row} for name in levels}
    return {name: [one for one in own if one in given[name]] for name, own in levels.items()}
