"""The analyses that the study declared (experiments/definition/analyses.py), a table each, and one
more with the coefficients of a mixed model.

A participant has one value of a measure in each condition: the mean over their sessions of a
metric, or of the score of a questionnaire's item, topic or whole ("overall"), with reverse-coded
items counted from the other end. Only a questionnaire whose items are one scale has a whole.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from experiments.analysis.dataset.records import Dataset
from experiments.analysis.metrics.definitions import METRICS
from experiments.analysis.metrics.sessions import Measured
from experiments.analysis.statistics.comparisons import Test, holm
from experiments.analysis.statistics.conditions import compare
from experiments.analysis.statistics.mixed_models import (
    CannotFitError,
    MixedModel,
    design_of,
    fit,
)
from experiments.analysis.tables.comparisons import (
    READ_AS,
    REMARK,
    TESTED,
    Group,
    compared,
    corrected_for,
    estimated,
    head_of,
    tested,
)
from experiments.analysis.tables.effects import family, values_by_participant
from experiments.analysis.tables.paper_tables import behind_statements
from experiments.analysis.tables.response_selection import RULES, counted
from experiments.analysis.tables.scored_responses import coded, mean_scores
from experiments.analysis.tables.table import Table, TableCell, count, number, probability, words
from experiments.definition.analyses import DeclaredAnalysis
from experiments.definition.factors import conditions_together
from experiments.definition.plan import (
    EXPLORATORY,
    Hypothesis,
    deciding_hypotheses,
    is_confirmatory,
)
from surveys.scoring import ScoredScale, measured_scale

Row = tuple[TableCell, ...]
PLANNED = "Plan"  # the column that names the hypotheses of a row; only in a study with hypotheses
SIDES = ("first", "second")
FITTED = (
    "Linear mixed model with an intercept for each participant, by REML; Wald F and t tests with"
    " the degrees of freedom of the between-within method."
)
SPREADS = (
    "from, to: 95 % confidence interval. SD: between participants, and of the residuals; ICC:"
    " intraclass correlation."
)
FREEDOM = (
    "df: by the between-within method, as in R's nlme (Pinheiro and Bates, Mixed-Effects Models in"
    " S and S-PLUS, 2000, section 2.4.2). A coefficient that changes within participants has the"
    " observations less participants less such coefficients; any other has the participants less"
    " the others, the intercept among them. The intercept itself has the larger of the two."
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

    def of(self, measure: str, condition: str) -> Group:
        """Return a measure in a condition: a value a participant, and the sessions behind them."""
        questionnaire, point, item = measure.partition(".")
        if not point:
            own = [one.session.id for one in self.measured if one.session.condition == condition]
            known = measure in {column.name for column in METRICS}
            values = values_by_participant(self.measured, measure, condition) if known else {}
            return values, own if values else []
        scale = self._scale(questionnaire, item)
        if scale is None:
            return {}, ()
        responses = coded(self.dataset, counted(self.dataset, questionnaire, condition))
        return mean_scores(responses, scale), behind_statements(scale.items, responses)

    def _scale(self, questionnaire: str, item: str) -> ScoredScale | None:
        """Return the scale that a measure names: the whole, a topic, or an item by itself."""
        definition = self.dataset.questionnaire(questionnaire)
        return None if definition is None else measured_scale(definition, item)

    def is_known(self, measure: str) -> bool:
        """Tell whether there is such a measure: a misspelt one has no value anywhere."""
        questionnaire, point, item = measure.partition(".")
        if not point:
            return measure in {column.name for column in METRICS}
        return self._scale(questionnaire, item) is not None

    def conditions_together(self) -> list[set[str]]:
        """Return the sets of conditions that one participant may have."""
        return [set(keys) for keys in conditions_together(self.dataset.study)]


def declared(dataset: Dataset, measured: Sequence[Measured]) -> tuple[Table, ...]:
    """Return the tables of all analyses that the study declared."""
    data = Data(dataset, measured)
    return tuple(
        table
        for one in dataset.study.analyses
        for table in (_mixed(one, data) if one.test == "mixed" else (_compared(one, data),))
    )


def planned(
    one: DeclaredAnalysis,
    data: Data,
    measure: str,
    *,
    contrast: int | None = None,
    effect: str = "",
) -> Row:
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
    sides = [
        (
            (measure, title, number_),
            [_side(data, measure, keys) for keys in (first, second)],
            _is_paired(data, first, second),
        )
        for measure in one.measures
        for number_, (title, first, second) in enumerate(pairs, start=1)
    ]
    tests = [
        compare(
            {key: values for key, (values, _) in zip(SIDES, groups_, strict=True)},
            is_paired=is_paired,
            by_ranks=one.test == "ranks",
        )
        for _, groups_, is_paired in sides
    ]
    corrected, members = corrected_for(tests, [groups_ for _, groups_, _ in sides])
    cells = [
        (
            words(measure),
            *compared(title, groups_, _told(test, measure, data), p, is_ordinal=True),
            *planned(one, data, measure, contrast=number_),
        )
        for ((measure, title, number_), groups_, _), test, p in zip(
            sides, tests, corrected, strict=True
        )
    ]
    head = ("Measure", "Contrast", *head_of(SIDES, is_ordinal=True), *_plan_head(data))
    rows = [*([] if one.contrasts else _omnibus(one, data)), *cells]
    notes = (
        "Declared in the study's definition, which is frozen when the study is published."
        + ("" if one.contrasts else " all: every condition at once, corrected among themselves."),
        f"p (Holm): {members} different tests of contrasts are one family.",
        RULES[data.dataset.study.analysis.counts],
        *READ_AS,
        "r: rank-biserial correlation; ε²: epsilon squared. Difference of ranks: Hodges-Lehmann.",
    )
    return Table(name_of(one), _title(one, data), head, tuple(rows), notes)


def _omnibus(one: DeclaredAnalysis, data: Data) -> Iterator[Row]:
    keys = _conditions(one, data)
    found = [[data.of(measure, key) for key in keys] for measure in one.measures]
    tests = [
        compare(
            {key: values for key, (values, _) in zip(keys, row, strict=True)},
            is_paired=any(set(keys) <= together for together in data.conditions_together()),
            by_ranks=one.test == "ranks",
        )
        for row in found
    ]
    corrected, _ = corrected_for(tests, found)
    blank = tuple(words("") for _ in head_of(SIDES, is_ordinal=True)[: -len(TESTED)])
    for measure, test, p in zip(one.measures, tests, corrected, strict=True):
        told = tested(_told(test, measure, data), p)
        yield words(measure), words("all"), *blank, *told, *planned(one, data, measure)


def _told(test: Test, measure: str, data: Data) -> Test:
    return test if data.is_known(measure) else Test(test.name, 0, remark="no such measure")


def _conditions(one: DeclaredAnalysis, data: Data) -> tuple[str, ...]:
    return one.conditions or tuple(condition.key for condition in data.dataset.study.conditions)


def _pairs(one: DeclaredAnalysis, data: Data) -> list[tuple[str, tuple[str, ...], tuple[str, ...]]]:
    if one.contrasts:
        return [(data.dataset.say(it.title), it.first, it.second) for it in one.contrasts]
    if not one.post_hoc:
        return []
    return [(f"{a} − {b}", (a,), (b,)) for a, b in combinations(_conditions(one, data), 2)]


def _is_paired(data: Data, first: Sequence[str], second: Sequence[str]) -> bool:
    """Tell whether a participant has conditions of both sides."""
    return any(
        together.intersection(first) and together.intersection(second)
        for together in data.conditions_together()
    )


def _side(data: Data, measure: str, keys: Sequence[str]) -> Group:
    """Return the means of participants over the conditions of a side; those who lack one of the
    conditions that they were to have on it have none.
    """
    found = {key: data.of(measure, key) for key in keys}
    values: dict[str, float] = {}
    for together in data.conditions_together():
        own = [found[key][0] for key in keys if key in together]
        if own:
            shared = set.intersection(*(set(one) for one in own))
            values |= {who: sum(one[who] for one in own) / len(own) for who in shared}
    return dict(sorted(values.items())), [ids for _, own_ids in found.values() for ids in own_ids]


# --- mixed models ---------------------------------------------------------------------------------


def _mixed(one: DeclaredAnalysis, data: Data) -> tuple[Table, Table]:
    fits = {measure: _model(one, data, measure) for measure in one.measures}
    ps = [
        test.p for model in fits.values() if isinstance(model, MixedModel) for test in model.terms
    ]
    corrected = iter(holm(ps))
    rows: list[Row] = []
    coefficients: list[Row] = []
    for measure, model in fits.items():
        if isinstance(model, str):
            blank = tuple(words("") for _ in range(9))
            own = planned(one, data, measure)
            rows.append((words(measure), *blank, words(model), *own))
            continue
        remark = "participants do not differ (variance 0)" if model.is_singular else ""
        rows += [
            (
                *(words(measure), words(test.name), count(model.participants)),
                *(count(model.observations), words("Wald F"), number(test.f, 2)),
                *(number(test.df[0], 0), number(test.df[1], 0), probability(test.p)),
                *(probability(next(corrected)), words(remark)),
                *planned(one, data, measure, effect=test.name),
            )
            for test in model.terms
        ]
        coefficients += _coefficients(measure, model)
    head = ("Measure", "Effect", "Participants", "Observations", "Test", "Statistic")
    title = _title(one, data)
    return (
        Table(
            name_of(one),
            title,
            (*head, "df", "df 2", "p", "p (Holm)", REMARK, *_plan_head(data)),
            tuple(rows),
            (FITTED, family(len(ps))),
        ),
        Table(
            f"{name_of(one)}-coefficients",
            title.removesuffix(".") + ": coefficients.",
            ("Measure", "Coefficient", "Estimate", "from", "to", "SE", "t", "df", "p"),
            tuple(coefficients),
            (
                CODED[one.coding],
                FREEDOM,
                SPREADS,
            ),
        ),
    )


def _coefficients(measure: str, model: MixedModel) -> Iterator[Row]:
    for it in model.coefficients:
        yield (
            *(words(measure), words(it.name), *estimated(it.estimate, 3), number(it.error, 3)),
            *(number(it.t, 2), number(it.df, 0), probability(it.p)),
        )
    total = model.sd_participants**2 + model.sd_residual**2
    for name, value in (
        ("SD participants", model.sd_participants),
        ("SD residual", model.sd_residual),
        ("ICC", model.sd_participants**2 / total),
    ):
        yield (words(measure), words(name), number(value, 3), *(words("") for _ in range(6)))


def _model(one: DeclaredAnalysis, data: Data, measure: str) -> MixedModel | str:
    """Return the model of a measure, or why there is none."""
    if not data.is_known(measure):
        return "no such measure"
    study = data.dataset.study
    orders = {person.id: person.cell for person in data.dataset.participants}
    outcome, rows, who = [], [], []
    for condition in study.conditions:
        if one.conditions and condition.key not in one.conditions:
            continue
        values, _ids = data.of(measure, condition.key)
        for participant, value in values.items():
            order = orders.get(participant, "")
            places = order.split("-")
            period = places.index(condition.key) + 1 if condition.key in places else 0
            own = {"condition": condition.key, "order": order, "period": str(period)}
            outcome.append(value)
            rows.append({**condition.levels, **own})
            who.append(participant)
    try:
        design = design_of(_levels(data, rows), one.effects, rows, one.coding)
        return fit(np.array(outcome), design, one.effects, who)
    except CannotFitError as error:
        return str(error)


def _levels(data: Data, rows: Sequence[Mapping[str, str]]) -> dict[str, list[str]]:
    """Return the levels of everything that a model may name; of the study's own, those that it
    declares and that have data.
    """
    study = data.dataset.study
    written = {factor.key: [level.key for level in factor.levels] for factor in study.factors}
    written["condition"] = [condition.key for condition in study.conditions]
    for name in ("period", "order"):
        written[name] = sorted({row[name] for row in rows})
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
