"""The analyses that the study declared (experiments/definition/analyses.py), a table each, and one
more with the coefficients of a model.

In tests of means and ranks, and in mixed models, a participant has one value of a measure in each
condition: the mean over their sessions of a metric, or of the score of a questionnaire's item,
topic or whole ("overall"), with reverse-coded items counted from the other end. Only a
questionnaire whose items are one scale has a whole. Proportions, counts and times are of each
session.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import cast

import numpy as np

from experiments.analysis.metrics.definitions import (
    CENSORED,
    KINDS,
    METRICS,
    OF_COMPLETED,
    PER_MINUTE,
)
from experiments.analysis.metrics.sessions import Measured
from experiments.analysis.statistics.comparisons import Test, holm
from experiments.analysis.statistics.conditions import Compared, compare
from experiments.analysis.statistics.mixed_models import fit
from experiments.analysis.statistics.models import (
    CannotFitError,
    Design,
    FittedModel,
    Row,
    design_of,
)
from experiments.analysis.statistics.regression import (
    SCORE,
    DriveOutcome,
    Family,
    compare_drives,
    fit_family,
)
from experiments.analysis.tables.comparisons import (
    READ_AS,
    REMARK,
    TESTED,
    ComparedSide,
    compared,
    corrected_for,
    estimated,
    family,
    head_of,
    tested,
)
from experiments.analysis.tables.drive_outcomes import (
    CENSORED_AT_END,
    ONLY_KNOWN,
    RATES,
    UNMOVED,
    group_of,
    outcomes,
    sessions_of,
    values_by_participant,
)
from experiments.analysis.tables.paper_tables import behind_statements
from experiments.analysis.tables.response_selection import RULES, counted
from experiments.analysis.tables.scored_responses import coded, mean_scores
from experiments.analysis.tables.table import Table, TableCell, count, number, probability, words
from experiments.dataset.records import Dataset
from experiments.definition.analyses import AGE, FAMILIES, DeclaredAnalysis
from experiments.definition.factors import conditions_together
from experiments.definition.plan import (
    EXPLORATORY,
    Hypothesis,
    deciding_hypotheses,
    is_confirmatory,
)
from surveys.scoring import ScoredScale, measured_scale

Cells = tuple[TableCell, ...]
PLANNED = "Plan"  # the column that names the hypotheses of a row; only in a study with hypotheses
SIDES = ("first", "second")
TESTS = {"mixed": "Wald F", **SCORE}
DIFFERENCE = ("Difference", "Difference: from", "Difference: to")
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


@dataclass(frozen=True)
class Data:
    """What an analysis reads: the study's dataset and its measured sessions."""

    dataset: Dataset
    measured: Sequence[Measured]

    def of(self, measure: str, condition: str) -> ComparedSide:
        """Return a measure in a condition: a value a participant, and the sessions behind them."""
        questionnaire, point, item = measure.partition(".")
        if not point:
            own = self._driven(condition, measure)
            known = measure in {column.name for column in METRICS}
            values = values_by_participant(own, measure) if known else {}
            return ComparedSide(values, [one.session.id for one in own] if values else [])
        scale = self._scale(questionnaire, item)
        if scale is None:
            return ComparedSide({})
        responses = coded(self.dataset, counted(self.dataset, questionnaire, condition))
        return ComparedSide(
            mean_scores(responses, scale), behind_statements(scale.items, responses)
        )

    def drives(self, test: str, measure: str, condition: str) -> list[DriveOutcome]:
        """Return what a model takes of a condition: each session's outcome, or each participant's
        mean.
        """
        if test not in FAMILIES:
            return [DriveOutcome(*one) for one in self.of(measure, condition).values.items()]
        if KINDS.get(measure) != test:
            return []
        return list(outcomes(self._driven(condition, measure), KINDS[measure], measure))

    def _driven(self, condition: str, measure: str) -> list[Measured]:
        own = (one for one in self.measured if one.session.condition == condition)
        return sessions_of(measure, own)

    def side(
        self, test: str, measure: str, keys: Sequence[str]
    ) -> tuple[list[DriveOutcome], ComparedSide]:
        """Return the drives of a side of a contrast and what is printed of them. Means of a
        participant are over all conditions that they were to have on it; who lacks one has none.
        """
        found = {key: self.drives(test, measure, key) for key in keys}
        if test in FAMILIES:
            drives = [one for own in found.values() for one in own]
            ids = [one.session.id for key in keys for one in self._driven(key, measure)]
            group = group_of(KINDS[measure], drives) if drives else ComparedSide({})
            return drives, ComparedSide(group.values, ids, group.is_censored, group.median)
        groups = {key: self.of(measure, key) for key in keys}
        values: dict[str, float] = {}
        for together in self.conditions_together():
            own = [groups[key].values for key in keys if key in together]
            if own:
                shared = set.intersection(*(set(one) for one in own))
                values |= {who: sum(one[who] for one in own) / len(own) for who in shared}
        values = dict(sorted(values.items()))
        ids = [session for group in groups.values() for session in group.sessions]
        return [DriveOutcome(*one) for one in values.items()], ComparedSide(values, ids)

    def covariate(self, name: str) -> tuple[dict[str, str | float], tuple[str, ...]]:
        """Return each participant's value of a covariate, and its levels in the order of the
        questionnaire; a number has none.
        """
        if name == AGE:
            ages = {one.id: one.age for one in self.dataset.participants if one.age == one.age}
            return dict(ages), ()
        questionnaire, _, item = name.partition(".")
        found = {
            one.participant: one.values[item]
            for one in coded(self.dataset, counted(self.dataset, questionnaire))
            if one.values.get(item) is not None
        }
        if all(isinstance(value, int | float) for value in found.values()):
            return {who: float(value) for who, value in found.items()}, ()
        definition = self.dataset.questionnaire(questionnaire)
        question = definition.question(item) if definition is not None else None
        known = [str(value) for value, _ in question.labelled_values] if question else []
        given = {str(value) for value in found.values()}
        levels = [one for one in known if one in given] + sorted(given - set(known))
        return {who: str(value) for who, value in found.items()}, tuple(levels)

    def _scale(self, questionnaire: str, item: str) -> ScoredScale | None:
        """Return the scale that a measure names: the whole, a topic, or an item by itself."""
        definition = self.dataset.questionnaire(questionnaire)
        return None if definition is None else measured_scale(definition, item)

    def unknown(self, test: str, measure: str) -> str:
        """Return why a measure has no value anywhere: it is misspelt, or the test is not for it."""
        questionnaire, point, item = measure.partition(".")
        is_metric = measure in {column.name for column in METRICS}
        if not (is_metric if not point else self._scale(questionnaire, item)):
            return "no such measure"
        return f"not one of {test}" if test in FAMILIES and KINDS.get(measure) != test else ""

    def conditions_together(self) -> list[set[str]]:
        """Return the sets of conditions that one participant may have."""
        return [set(keys) for keys in conditions_together(self.dataset.study)]


def declared(dataset: Dataset, measured: Sequence[Measured]) -> tuple[Table, ...]:
    """Return the tables of all analyses that the study declared."""
    data = Data(dataset, measured)
    return tuple(
        table
        for one in dataset.study.analyses
        for table in (_modelled(one, data) if one.is_model else (_compared(one, data),))
    )


def planned(
    one: DeclaredAnalysis,
    data: Data,
    measure: str,
    *,
    contrast: int | None = None,
    effect: str = "",
) -> Cells:
    """Return the cell that names the hypotheses of a test; none in a study without hypotheses."""
    study = data.dataset.study
    if not is_confirmatory(study.plan):
        return ()
    found = deciding_hypotheses(study.plan, one, measure, contrast=contrast, effect=effect)
    return (words(_named(found, is_post_hoc=contrast is not None and not one.contrasts)),)


def _named(found: Sequence[Hypothesis], *, is_post_hoc: bool) -> str:
    if not found:
        return EXPLORATORY
    keys = ", ".join(one.key for one in found)
    return f"post hoc of {keys}" if is_post_hoc else keys


def _plan_head(data: Data) -> tuple[str, ...]:
    return (PLANNED,) if is_confirmatory(data.dataset.study.plan) else ()


# --- contrasts, and several conditions ------------------------------------------------------------


def _compared(one: DeclaredAnalysis, data: Data) -> Table:
    pairs = _pairs(one, data)
    named = [(measure, *pair) for measure in one.measures for pair in enumerate(pairs, start=1)]
    found = [
        _test_sides(one, data, measure, dict(zip(SIDES, sides, strict=True)))
        for measure, _, (_, *sides) in named
    ]
    corrected, members = corrected_for([test for test, _ in found], [own for _, own in found])
    cells = [
        (
            words(measure),
            *compared(title, groups, test, p),
            *planned(one, data, measure, contrast=number_),
        )
        for (measure, number_, (title, *_)), (test, groups), p in zip(
            named, found, corrected, strict=True
        )
    ]
    head = ("Measure", "Contrast", *head_of(SIDES), *_plan_head(data))
    rows = [*([] if one.contrasts else _omnibus(one, data)), *cells]
    notes = (
        "Declared in the study's definition, which is frozen when the study is published."
        + ("" if one.contrasts else " all: every condition at once, corrected among themselves."),
        f"p (Holm): {members} different tests of contrasts are one family.",
        RULES[data.dataset.study.analysis.counts],
        *_about_metrics(one),
        *READ_AS,
        "r: rank-biserial correlation; ε²: epsilon squared. Difference of ranks: Hodges-Lehmann.",
    )
    return Table(name_of(one), _title(one, data), head, tuple(rows), notes)


def _about_metrics(one: DeclaredAnalysis) -> tuple[str, ...]:
    """Return what is done about sessions that were cut short, in sentences."""
    if one.test == "times":
        return (CENSORED_AT_END, UNMOVED)
    if one.test == "proportions":
        return (UNMOVED,)
    times = (ONLY_KNOWN,) if CENSORED.intersection(one.measures) else ()
    rates = (PER_MINUTE | OF_COMPLETED).intersection(one.measures)
    return (*times, *((RATES,) if rates else ()))


def _test_sides(
    one: DeclaredAnalysis, data: Data, measure: str, sides: Mapping[str, Sequence[str]]
) -> tuple[Test, list[ComparedSide]]:
    """Return the test of a measure between sides, of some conditions each, and their groups."""
    found = {name: data.side(one.test, measure, keys) for name, keys in sides.items()}
    groups = [group for _, group in found.values()]
    if why := data.unknown(one.test, measure):
        return Test("–", 0, remark=why), groups
    if one.test in FAMILIES:
        drives = {name: own for name, (own, _) in found.items()}
        return compare_drives(KINDS[measure], drives), groups
    values = {name: group.values for name, (_, group) in found.items()}
    by, is_paired = cast("Compared", one.test), _is_paired(data, list(sides.values()))
    return compare(values, is_paired=is_paired, by=by), groups


def _omnibus(one: DeclaredAnalysis, data: Data) -> Iterator[Cells]:
    keys = _conditions(one, data)
    found = [
        _test_sides(one, data, measure, {key: (key,) for key in keys}) for measure in one.measures
    ]
    corrected, _ = corrected_for([test for test, _ in found], [own for _, own in found])
    blank = tuple(words("") for _ in head_of(SIDES)[: -len(TESTED)])
    for measure, (test, _), p in zip(one.measures, found, corrected, strict=True):
        told = tested(test, p)
        yield words(measure), words("all"), *blank, *told, *planned(one, data, measure)


def _conditions(one: DeclaredAnalysis, data: Data) -> tuple[str, ...]:
    return one.conditions or tuple(condition.key for condition in data.dataset.study.conditions)


def _pairs(one: DeclaredAnalysis, data: Data) -> list[tuple[str, tuple[str, ...], tuple[str, ...]]]:
    if one.contrasts:
        return [(data.dataset.say(it.title), it.first, it.second) for it in one.contrasts]
    if not one.post_hoc:
        return []
    return [(f"{a} − {b}", (a,), (b,)) for a, b in combinations(_conditions(one, data), 2)]


def _is_paired(data: Data, sides: Sequence[Sequence[str]]) -> bool:
    """Tell whether a participant has conditions of all sides."""
    return any(
        all(together.intersection(side) for side in sides)
        for together in data.conditions_together()
    )


# --- models ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ModelData:
    """The observations of a model, what each has of its terms, and the levels of these."""

    observed: Sequence[DriveOutcome]
    rows: Sequence[Row]
    levels: Mapping[str, Sequence[str]]
    remark: str

    def fit(self, one: DeclaredAnalysis) -> FittedModel:
        """Return the model with terms in sum coding and coefficients in the one that is declared.

        Raises:
            CannotFitError: there is none.
        """
        terms = (*one.effects, *one.covariates)
        found = self._fit(one.test, terms, design_of(self.levels, terms, self.rows, "sum"))
        if one.coding == "sum":
            return found
        design = design_of(self.levels, terms, self.rows, one.coding)
        return replace(found, coefficients=self._fit(one.test, terms, design).coefficients)

    def _fit(self, test: str, terms: Sequence[str], design: Design) -> FittedModel:
        if test != "mixed":
            return fit_family(cast("Family", test), self.observed, design, terms)
        values = np.array([one.value for one in self.observed])
        return fit(values, design, terms, [one.who for one in self.observed])


def _modelled(one: DeclaredAnalysis, data: Data) -> tuple[Table, Table]:
    fits = {measure: _model(one, data, measure) for measure in one.measures}
    ps = [
        test.p
        for model in fits.values()
        if isinstance(model, FittedModel)
        for test in model.terms[: len(one.effects)]
    ]
    corrected = iter(holm(ps))
    rows: list[Cells] = []
    coefficients: list[Cells] = []
    head = ("Measure", "Effect", "Participants", "Observations", "Test", "Statistic", "df", "df 2")
    for measure, model in fits.items():
        if isinstance(model, str):
            blank = tuple(words("") for _ in range(len(head) + 4))
            rows.append((words(measure), *blank, words(model), *planned(one, data, measure)))
            continue
        for test in model.terms:
            p, own = words(""), tuple(words(EXPLORATORY) for _ in _plan_head(data))
            if test.name in one.effects:
                p = probability(next(corrected))
                own = planned(one, data, measure, effect=test.name)
            rows.append(
                (
                    *(words(measure), words(test.name), count(model.participants)),
                    *(count(model.observations), words(TESTS[one.test]), number(test.f, 2)),
                    *(number(test.df[0], 0), number(test.df[1], 1), probability(test.p), p),
                    *(*estimated(test.difference, 3), words(model.remark), *own),
                )
            )
        coefficients += _coefficients(measure, model)
    title = _title(one, data)
    about = (MODELS[one.test], *(() if one.test == "mixed" else (CLUSTERED,)))
    return (
        Table(
            name_of(one),
            title,
            (*head, "p", "p (Holm)", *DIFFERENCE, REMARK, *_plan_head(data)),
            tuple(rows),
            (*about, IN_SUM_CODING, family(len(ps)), *_about_metrics(one)),
        ),
        Table(
            f"{name_of(one)}-coefficients",
            title.removesuffix(".") + ": coefficients.",
            ("Measure", "Coefficient", "Estimate", "from", "to", "SE", "t", "df", "p"),
            tuple(coefficients),
            (CODED[one.coding], *about, SPREADS),
        ),
    )


def _coefficients(measure: str, model: FittedModel) -> Iterator[Cells]:
    for it in model.coefficients:
        yield (
            *(words(measure), words(it.name), *estimated(it.estimate, 3), number(it.error, 3)),
            *(number(it.t, 2), number(it.df, 1), probability(it.p)),
        )
    for name, value in model.spreads:
        yield (words(measure), words(name), number(value, 3), *(words("") for _ in range(6)))


def _model(one: DeclaredAnalysis, data: Data, measure: str) -> FittedModel | str:
    """Return the model of a measure, or why there is none."""
    if why := data.unknown(one.test, measure):
        return why
    try:
        own = model_data(one, data, measure)
        found = own.fit(one)
    except CannotFitError as error:
        return str(error)
    return replace(found, remark="; ".join(filter(None, (found.remark, own.remark))))


def model_data(one: DeclaredAnalysis, data: Data, measure: str) -> ModelData:
    """Return the observations of a model; participants whose covariates are unknown have none."""
    study = data.dataset.study
    orders = {person.id: person.cell for person in data.dataset.participants}
    covariates = {name: data.covariate(name) for name in one.covariates}
    observed: list[DriveOutcome] = []
    rows: list[dict[str, str | float]] = []
    lacking: set[str] = set()
    for condition in study.conditions:
        if one.conditions and condition.key not in one.conditions:
            continue
        for drive in data.drives(one.test, measure, condition.key):
            given = {name: values.get(drive.who) for name, (values, _) in covariates.items()}
            if None in given.values():
                lacking.add(drive.who)
                continue
            order = orders.get(drive.who, "")
            places = order.split("-")
            period = places.index(condition.key) + 1 if condition.key in places else 0
            own = {"condition": condition.key, "order": order, "period": str(period)}
            observed.append(drive)
            rows.append({**condition.levels, **own, **given})  # type: ignore[dict-item]
    if not observed:
        raise CannotFitError("fewer than three participants")
    levels = _levels(data, rows) | {name: known for name, (_, known) in covariates.items()}
    said = f"participants without a covariate: {len(lacking)}" if lacking else ""
    return ModelData(observed, rows, levels, said)


def _levels(data: Data, rows: Sequence[Row]) -> dict[str, Sequence[str]]:
    """Return the levels of everything that a model may name; of the study's own, those that it
    declares and that have data.
    """
    study = data.dataset.study
    written = {factor.key: [level.key for level in factor.levels] for factor in study.factors}
    written["condition"] = [condition.key for condition in study.conditions]
    for name in ("period", "order"):
        written[name] = sorted({str(row[name]) for row in rows})
    given = {name: {row[name] for row in rows if name in row} for name in written}
    return {
        name: [level for level in levels if level in given[name]]
        for name, levels in written.items()
    }


def name_of(one: DeclaredAnalysis) -> str:
    """Return the name of an analysis's table."""
    return f"analysis-{one.key.replace('_', '-')}"


def _title(one: DeclaredAnalysis, data: Data) -> str:
    return f"{data.dataset.say(one.title).removesuffix('.')}."
