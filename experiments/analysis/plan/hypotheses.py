"""What the plan of a study says of its report: the hypotheses with the tests that decide on them,
and which tables and figures are exploratory.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from experiments.analysis.dataset.records import Dataset
from experiments.analysis.figures.drawing import Drawing
from experiments.analysis.statistics.comparisons import holm
from experiments.analysis.statistics.regression import RATIO
from experiments.analysis.tables.declared import PLANNED, name_of
from experiments.analysis.tables.table import Table, TableCell, number, probability, words
from experiments.definition.analyses import DeclaredAnalysis
from experiments.definition.plan import Hypothesis, StudyPlan, is_confirmatory, measures_of
from experiments.definition.schema import StudyDefinition

NO_PLAN = "No plan was declared: everything here is exploratory."
NO_HYPOTHESIS = "The plan has no hypothesis: everything here is exploratory."
NOT_PLANNED = "Exploratory: the plan of the study does not have this."
PRECISION = (
    "p (family): corrected by Holm's method for the tests of the family; without a family, for"
    " those of its analysis. p values are two-sided."
)
HEAD = (
    *("Hypothesis", "Expected", "Measure", "Test", "p", "p (family)", "Difference"),
    *("As expected", "Significant"),
)
EXPECTED = {"different": "a difference", "greater": "first greater", "less": "first less"}
Row = tuple[TableCell, ...]


@dataclass(frozen=True)
class DecidingTest:
    """A row of a declared table that decides on a hypothesis; `difference` is NaN or None where the
    test has no direction.
    """

    hypothesis: Hypothesis
    analysis: str
    measure: str
    label: str
    p: float
    corrected: float
    difference: float | None


def hypotheses_table(dataset: Dataset, tables: Sequence[Table]) -> Table:
    """Return each hypothesis with its tests, from the tables of the declared analyses."""
    plan = dataset.study.plan
    title = "Hypotheses of the plan."
    if plan is None or not plan.hypotheses:
        said = NO_PLAN if plan is None else NO_HYPOTHESIS
        return Table("hypotheses", title, (PLANNED,), ((words(said),),))
    tests = list(_tests(dataset.study, plan, {table.name: table for table in tables}))
    corrected = family_corrected(plan, tests)
    rows = tuple(_row(plan, one, p) for one, p in zip(tests, corrected, strict=True))
    texts = tuple(f"{one.key}: {one.text}" for one in plan.hypotheses)
    alpha = f"Significant: p (family) below {plan.alpha:g}."
    return Table("hypotheses", title, HEAD, rows, (*texts, PRECISION, alpha))


def _row(plan: StudyPlan, one: DecidingTest, p: float) -> Row:
    signed = one.difference
    return (
        words(one.hypothesis.key),
        words(EXPECTED[one.hypothesis.direction]),
        words(one.measure),
        words(f"{one.analysis}: {one.label}"),
        probability(one.p),
        probability(p),
        number(signed, 3),
        words(_as_expected(one.hypothesis, signed)),
        words("unknown" if math.isnan(p) else "yes" if p < plan.alpha else "no"),
    )


def _as_expected(hypothesis: Hypothesis, difference: float | None) -> str:
    if hypothesis.direction == "different":
        return "–"
    if difference is None or math.isnan(difference):
        return "unknown"
    signed = difference if hypothesis.direction == "greater" else -difference
    return "yes" if signed > 0.0 else "no"


def family_corrected(plan: StudyPlan, tests: Sequence[DecidingTest]) -> list[float]:
    """Return the p values of tests, corrected within their family; those of a hypothesis without
    one keep the correction of their analysis.
    """
    corrected = [one.corrected for one in tests]
    for family in plan.families:
        places = [n for n, one in enumerate(tests) if one.hypothesis.key in family.hypotheses]
        members = [(tests[n].analysis, tests[n].measure, tests[n].label) for n in places]
        for n, p in zip(places, holm([tests[n].p for n in places], members), strict=True):
            corrected[n] = p
    return corrected


def _tests(
    study: StudyDefinition, plan: StudyPlan, tables: dict[str, Table]
) -> Iterator[DecidingTest]:
    known = {one.key: one for one in study.analyses}
    for hypothesis in plan.hypotheses:
        analysis = known.get(hypothesis.analysis)
        table = tables.get(name_of(analysis)) if analysis is not None else None
        if analysis is None or table is None:
            continue
        for row in table.rows:
            cells = dict(zip(table.head, row, strict=True))
            if hypothesis.key in cells[PLANNED].text.split(", "):
                yield _test(hypothesis, analysis, cells)


def _test(
    hypothesis: Hypothesis,
    analysis: DeclaredAnalysis,
    cells: dict[str, TableCell],
) -> DecidingTest:
    measure = cells["Measure"].text
    label = cells.get("Contrast", cells.get("Effect", words(""))).text
    p, corrected = (_value(cells[name]) for name in ("p", "p (Holm)"))
    difference = _difference(cells)
    return DecidingTest(hypothesis, analysis.key, measure, label, p, corrected, difference)


def _difference(cells: dict[str, TableCell]) -> float | None:
    """Return by how much the first side is greater; of a rate or hazard ratio, its logarithm."""
    if cells["Difference"].value is not None:
        return cells["Difference"].value
    is_ratio = "Effect" in cells and cells["Effect"].text in RATIO.values()
    size = cells["Size"].value if is_ratio else None
    return math.log(size) if size else None


def _value(cell: TableCell) -> float:
    return float("nan") if cell.value is None else cell.value


# --- what is exploratory --------------------------------------------------------------------------


def status_of(study: StudyDefinition, measures: Sequence[str]) -> str:
    """Return what is said of results on some measures: the hypotheses about them, or that they are
    exploratory; nothing in a study without hypotheses, which says so once.
    """
    plan = study.plan
    if plan is None or not plan.hypotheses:
        return ""
    analyses = {one.key: one for one in study.analyses}
    keys = [
        one.key
        for one in plan.hypotheses
        if one.analysis in analyses
        and set(measures).intersection(measures_of(one, analyses[one.analysis]))
    ]
    return f"Shows measures of: {', '.join(keys)}." if keys else NOT_PLANNED


def marked_table(study: StudyDefinition, table: Table) -> Table:
    """Return a table with tests that the plan does not have marked as exploratory; the declared
    ones say it row by row.
    """
    if not is_confirmatory(study.plan) or PLANNED in table.head or "p" not in table.head:
        return table
    if table.name.startswith("analysis-") or table.name == "hypotheses":
        return table
    return replace(table, notes=(*table.notes, NOT_PLANNED))


def marked_figure(study: StudyDefinition, figure: Drawing) -> Drawing:
    """Return a figure of answers with the hypotheses that it belongs to, or as exploratory."""
    questionnaire = _questionnaire_of(study, figure.name)
    if not is_confirmatory(study.plan) or not questionnaire:
        return figure
    declared = {measure for one in study.analyses for measure in one.measures}
    shown = [one for one in declared if one.partition(".")[0] == questionnaire and "." in one]
    notes = (*figure.numbers.notes, status_of(study, shown))
    return replace(figure, numbers=replace(figure.numbers, notes=notes))


def _questionnaire_of(study: StudyDefinition, name: str) -> str:
    if name.startswith("figure-scores-"):
        return name.removeprefix("figure-scores-")
    return study.analysis.statements if name.startswith("figure-8") else ""
