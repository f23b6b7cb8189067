"""The plan of a study in its report: which tests decide on hypotheses, exclusions, notes."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from experiments.analysis.documents.sentences import RowKey, key_of
from experiments.analysis.figures.drawing import Drawing
from experiments.analysis.statistics.comparisons import holm
from experiments.analysis.statistics.regression import RATIO
from experiments.analysis.tables.declared import PLANNED, name_of
from experiments.analysis.tables.table import Table, TableCell, number, probability, words
from experiments.dataset.grouping import by_key
from experiments.dataset.records import PlanExclusion
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
Cells = dict[str, TableCell]  # of a row, by their heads
LISTED = (
    "Rules of the plan exclude a participant with all sessions; participants who are only"
    " incomplete stay in tests of success and times. A fault of the record that the plan names, a"
    " platform fault or a researcher's decision excludes one session. Sessions that the platform"
    " ended count in no result."
)
EFFECTS_HEAD = (
    *("Analysis", "Measure", "Test", "p (Holm)", "p (Holm), all", "Difference", "Difference, all"),
    "Significance",
)
EXPECTED = {"different": "a difference", "greater": "first greater", "less": "first less"}


@dataclass(frozen=True)
class DecidingTest:
    """A row of a declared table that decides on a hypothesis. `corrected` is p in the family of the
    hypothesis (without one, of the analysis); `difference` is that of the first side, or level,
    less the second, and NaN or None where the test has no direction.
    """

    hypothesis: Hypothesis
    analysis: DeclaredAnalysis
    measure: str
    label: str
    p: float
    corrected: float
    difference: float | None


def decisions_of(study: StudyDefinition, tables: Sequence[Table]) -> list[DecidingTest]:
    """Return the tests in the tables of declared analyses that decide on hypotheses."""
    if study.plan is None:
        return []
    tests = [test for one in study.plan.hypotheses for test in _deciding(study, one, tables)]
    for family in study.plan.families:
        places = [n for n, one in enumerate(tests) if one.hypothesis.key in family.hypotheses]
        members = [(tests[n].analysis.key, tests[n].measure, tests[n].label) for n in places]
        for n, p in zip(places, holm([tests[n].p for n in places], members), strict=True):
            tests[n] = replace(tests[n], corrected=p)
    return tests


def hypotheses_table(study: StudyDefinition, decisions: Sequence[DecidingTest]) -> Table:
    plan = study.plan
    title = "Hypotheses of the plan."
    if plan is None or not plan.hypotheses:
        reason = NO_PLAN if plan is None else NO_HYPOTHESIS
        return Table.of("hypotheses", title, (PLANNED,), [[reason]])
    rows = (_row(plan, one) for one in decisions)
    texts = (f"{one.key}: {one.text}" for one in plan.hypotheses)
    alpha = f"Significant: p (family) below {plan.alpha:g}."
    return Table.of("hypotheses", title, HEAD, rows, (*texts, SELECTED, PRECISION, alpha))


def by_row(decisions: Sequence[DecidingTest]) -> dict[RowKey, list[tuple[str, float]]]:
    """Return the hypotheses on which each row of a declared table decides, with p in the family."""
    return by_key(
        ((name_of(one.analysis), one.measure, one.label), (one.hypothesis.key, one.corrected))
        for one in decisions
    )


def _row(plan: StudyPlan, one: DecidingTest) -> tuple[object, ...]:
    p, about = one.corrected, one.hypothesis
    significant = "unknown" if math.isnan(p) else "yes" if p < plan.alpha else "no"
    return (
        *(about.key, EXPECTED[about.direction], one.measure, f"{one.analysis.key}: {one.label}"),
        *(probability(one.p), probability(p), number(one.difference, 3)),
        *(_as_expected(about, one.difference), significant),
    )


def _as_expected(hypothesis: Hypothesis, difference: float | None) -> str:
    if hypothesis.direction == "different":
        return "–"
    if difference is None or math.isnan(difference):
        return "unknown"
    signed = difference if hypothesis.direction == "greater" else -difference
    return "yes" if signed > 0.0 else "no"


def _tests(tables: Sequence[Table]) -> Iterator[tuple[RowKey, Cells]]:
    """Yield the rows of tables of declared analyses: their names, and their cells by head."""
    for table in tables:
        if "p (Holm)" in table.head:
            for row in table.rows:
                cells = dict(zip(table.head, row, strict=True))
                yield key_of(table, cells), cells


def _deciding(
    study: StudyDefinition, hypothesis: Hypothesis, tables: Sequence[Table]
) -> Iterator[DecidingTest]:
    analysis = next((one for one in study.analyses if one.key == hypothesis.analysis), None)
    if analysis is None:
        return
    own = [table for table in tables if table.name == name_of(analysis)]
    for (_, measure, label), cells in _tests(own):
        if hypothesis.key in cells[PLANNED].text.split(", "):
            p, corrected = (_value(cells, name) for name in ("p", "p (Holm)"))
            difference = _difference(cells)
            yield DecidingTest(hypothesis, analysis, measure, label, p, corrected, difference)


def _value(cells: Cells, head: str) -> float:
    value = cells[head].value if head in cells else None
    return math.nan if value is None else value


def _difference(cells: Cells) -> float | None:
    """Return by how much the first side is greater; of a rate or hazard ratio, its logarithm."""
    if cells["Difference"].value is not None:
        return cells["Difference"].value
    is_ratio = "Effect" in cells and cells["Effect"].text in RATIO.values()
    size = cells["Size"].value if is_ratio else None
    return math.log(size) if size else None


# --- exclusions -----------------------------------------------------------------------------------


def exclusions_table(found: Sequence[PlanExclusion]) -> Table:
    rows = []
    for one in found:
        who = words(one.participant, (one.session,) if one.session else ())
        rows.append((who, one.session, one.rule, one.value, "yes" if one.planned else "no"))
    head = ("Participant", "Session", "Rule", "Value", PLANNED)
    return Table.of("exclusions", "Exclusions.", head, rows, (LISTED,))


def exclusion_effects(planned: Sequence[Table], every: Sequence[Table], alpha: float) -> Table:
    """Return the tests of the drives that count (`planned`) beside those of `every` drive."""
    others = dict(_tests(every))
    rows, changed = [], []
    for key, cells in _tests(planned):
        both = (cells, others.get(key, {}))
        ps = [_value(one, "p (Holm)") for one in both]
        differences = [number(_value(one, "Difference"), 3) for one in both]
        is_changed = (ps[0] < alpha) != (ps[1] < alpha)
        names = (key[0].removeprefix("analysis-"), *key[1:])
        changed += [", ".join(names)] if is_changed else []
        verdict = "changes" if is_changed else "same"
        rows.append((*names, *map(probability, ps), *differences, verdict))
    title = "Sensitivity analysis: declared tests with the excluded drives (all)."
    level = f"Significant: p (Holm) below {alpha:g}."
    note = f"The exclusions change the significance of: {'; '.join(changed)}."
    if not changed:
        note = "The exclusions change the significance of no declared test."
    return Table.of("exclusions-effect", title, EFFECTS_HEAD, rows, (level, note))


# --- notes of tables and figures ------------------------------------------------------------------


def marked_table(table: Table, *, is_sensitivity: bool) -> Table:
    """Add a note to a sensitivity analysis, and to tests that no hypothesis names."""
    if is_sensitivity:
        return replace(table, notes=(SENSITIVITY, *table.notes))
    if PLANNED in table.head or "p" not in table.head or table.name == "hypotheses":
        return table
    return replace(table, notes=(*table.notes, NOT_PLANNED))


def marked_figure(study: StudyDefinition, figure: Drawing, *, is_sensitivity: bool) -> Drawing:
    """Add a note to a sensitivity analysis; to answers, the hypotheses, or that they are
    exploratory.
    """
    notes, scores = figure.numbers.notes, "figure-scores-"
    questionnaire = study.statements if figure.name.startswith("figure-8") else ""
    if figure.name.startswith(scores):
        named = {name.replace(".", "-"): name for name in study.asked}
        questionnaire = named[figure.name.removeprefix(scores)]
    if is_sensitivity:
        notes = (SENSITIVITY, *notes)
    elif questionnaire:
        keys = ", ".join(_about(study, questionnaire))
        notes = (*notes, f"Shows measures of: {keys}." if keys else NOT_PLANNED)
    return replace(figure, numbers=replace(figure.numbers, notes=notes))


def _about(study: StudyDefinition, questionnaire: str) -> Iterator[str]:
    """Yield the hypotheses about measures of a questionnaire."""
    analyses = {one.key: one for one in study.analyses}
    for one in study.plan.hypotheses if study.plan is not None else ():
        measures = measures_of(one, analyses[one.analysis]) if one.analysis in analyses else ()
        if any(measure.startswith(f"{questionnaire}.") for measure in measures):
            yield one.key
