"""What the plan of a study says of its report: the hypotheses with the tests that decide on them,
and which tables and figures are exploratory.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from experiments.analysis.figures.drawing import Drawing
from experiments.analysis.statistics.comparisons import holm
from experiments.analysis.statistics.regression import RATIO
from experiments.analysis.tables.declared import PLANNED, name_of
from experiments.analysis.tables.table import Table, TableCell, number, probability, words
from experiments.definition.analyses import DeclaredAnalysis
from experiments.definition.plan import Hypothesis, StudyPlan, measures_of
from experiments.definition.schema import StudyDefinition

NO_PLAN = "No plan was declared: everything here is exploratory."
NO_HYPOTHESIS = "The plan has no hypothesis: everything here is exploratory."
NOT_PLANNED = "Exploratory: no hypothesis of the plan is tested here."
SENSITIVITY = (
    "Sensitivity analysis: with the drives and participants that are excluded from the results."
)
PRECISION = (
    "p (family): corrected by Holm's method for the tests of the family; without a family, for"
    " those of its analysis. p values are two-sided."
)
SELECTED = (
    "Of the drives that count: those that the plan or a researcher excludes are left out (table"
    " Exclusions)."
)
HEAD = (
    *("Hypothesis", "Expected", "Measure", "Test", "p", "p (family)", "Difference"),
    *("As expected", "Significant"),
)
EXPECTED = {"different": "a difference", "greater": "first greater", "less": "first less"}
Row = tuple[TableCell, ...]


@dataclass(frozen=True)
class DecidingTest:
    """A row of a declared table that decides on a hypothesis; `difference` is that of the first
    side, or level, less the second, and NaN or None where the test has no direction.
    """

    hypothesis: Hypothesis
    table: str
    analysis: str
    measure: str
    label: str
    p: float
    corrected: float
    difference: float | None


@dataclass(frozen=True)
class CorrectedTest:
    """A test that decides on a hypothesis, with p as corrected in the family."""

    test: DecidingTest
    p: float


def decisions_of(study: StudyDefinition, tables: Sequence[Table]) -> list[CorrectedTest]:
    """Return the tests that decide on the hypotheses of a study's plan, from the tables of its
    declared analyses.
    """
    if study.plan is None:
        return []
    tests = list(_tests(study, study.plan, {table.name: table for table in tables}))
    corrected = family_corrected(study.plan, tests)
    return [CorrectedTest(test, p) for test, p in zip(tests, corrected, strict=True)]


def hypotheses_table(study: StudyDefinition, decisions: Sequence[CorrectedTest]) -> Table:
    """Return each hypothesis with the tests that decide on it."""
    plan = study.plan
    title = "Hypotheses of the plan."
    if plan is None or not plan.hypotheses:
        reason = NO_PLAN if plan is None else NO_HYPOTHESIS
        return Table("hypotheses", title, (PLANNED,), ((words(reason),),))
    rows = tuple(_row(plan, one) for one in decisions)
    texts = tuple(f"{one.key}: {one.text}" for one in plan.hypotheses)
    alpha = f"Significant: p (family) below {plan.alpha:g}."
    return Table("hypotheses", title, HEAD, rows, (*texts, SELECTED, PRECISION, alpha))


def by_row(
    decisions: Sequence[CorrectedTest],
) -> dict[tuple[str, str, str], list[tuple[str, float]]]:
    """Return the hypotheses on which each row of a declared table decides, with p in the family; a
    row is named by its table, measure, and contrast or effect.
    """
    found: dict[tuple[str, str, str], list[tuple[str, float]]] = {}
    for one in decisions:
        key = (one.test.table, one.test.measure, one.test.label)
        found.setdefault(key, []).append((one.test.hypothesis.key, one.p))
    return found


def _row(plan: StudyPlan, decision: CorrectedTest) -> Row:
    one, p = decision.test, decision.p
    return (
        words(one.hypothesis.key),
        words(EXPECTED[one.hypothesis.direction]),
        words(one.measure),
        words(f"{one.analysis}: {one.label}"),
        probability(one.p),
        probability(p),
        number(one.difference, 3),
        words(_as_expected(one.hypothesis, one.difference)),
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
    difference, table = _difference(cells), name_of(analysis)
    return DecidingTest(hypothesis, table, analysis.key, measure, label, p, corrected, difference)


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
    """Return which hypotheses are about some measures, or that results on them are exploratory."""
    hypotheses = study.plan.hypotheses if study.plan is not None else ()
    analyses = {one.key: one for one in study.analyses}
    keys = [
        one.key
        for one in hypotheses
        if one.analysis in analyses
        and set(measures).intersection(measures_of(one, analyses[one.analysis]))
    ]
    return f"Shows measures of: {', '.join(keys)}." if keys else NOT_PLANNED


def marked_table(table: Table, *, is_sensitivity: bool) -> Table:
    """Return a table that says what it is: part of a sensitivity analysis; or exploratory, where it
    has tests that no hypothesis names. Those that have hypotheses say so row by row.
    """
    if is_sensitivity:
        return replace(table, notes=(SENSITIVITY, *table.notes))
    if PLANNED in table.head or "p" not in table.head or table.name == "hypotheses":
        return table
    return replace(table, notes=(*table.notes, NOT_PLANNED))


def marked_figure(study: StudyDefinition, figure: Drawing, *, is_sensitivity: bool) -> Drawing:
    """Return a figure that says that it is part of a sensitivity analysis; or, of answers, to which
    hypotheses it belongs, or that it is exploratory.
    """
    questionnaire = _questionnaire_of(study, figure.name)
    notes = figure.numbers.notes
    if is_sensitivity:
        notes = (SENSITIVITY, *notes)
    elif questionnaire:
        declared = {measure for one in study.analyses for measure in one.measures}
        shown = [one for one in declared if one.partition(".")[0] == questionnaire and "." in one]
        notes = (*notes, status_of(study, shown))
    return replace(figure, numbers=replace(figure.numbers, notes=notes))


def _questionnaire_of(study: StudyDefinition, name: str) -> str:
    if name.startswith("figure-scores-"):
        return name.removeprefix("figure-scores-")
    return study.analysis.statements if name.startswith("figure-8") else ""
