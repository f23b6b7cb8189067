"""Everything at once: a folder of tables and figures from a dataset, and nothing else, so that the
same dataset gives the same bytes.

    <selection>/tables/<name>.csv, .tex, .docx         every number and what it is made of
    <selection>/figures/<name>.svg, .pdf, .png, .csv   every figure and its numbers
    <selection>/results.txt, .tex, .docx               every test as a sentence
    <selection>/sources.json                           which sessions are behind every cell, bar and
                                                       trajectory
    SHA256SUMS                                         of all of these

A selection is `counting`, of the drives that count in results, or `all`, where something is
excluded: a sensitivity analysis with the excluded drives.
"""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any

from experiments.analysis.documents.latex import as_latex, latex, runs_as_latex
from experiments.analysis.documents.sentences import Decisions, Sentence, sentences_of
from experiments.analysis.documents.typesetting import Run
from experiments.analysis.documents.word import table_document, text_document
from experiments.analysis.figures.drawing import Drawing, as_pdf, as_png, as_svg, label_figure
from experiments.analysis.figures.opinions import figure_8a, figure_8b
from experiments.analysis.figures.scores import score_figures
from experiments.analysis.figures.trajectories import figure_6, figure_7
from experiments.analysis.metrics.definitions import VERSION
from experiments.analysis.metrics.sessions import Measured, measure_all
from experiments.analysis.plan import hypotheses
from experiments.analysis.plan.reporting_sheet import reporting_sheet
from experiments.analysis.plan.sensitivity import success_sensitivity
from experiments.analysis.tables import delays, effects, flow, paper_tables, people, summaries
from experiments.analysis.tables.declared import declared
from experiments.analysis.tables.scale_reliability import reliability_table
from experiments.analysis.tables.scores import score_tables
from experiments.analysis.tables.software import software_table
from experiments.analysis.tables.table import SessionSets, Table, as_csv
from experiments.dataset.counting import attempted, counting
from experiments.dataset.levels import Kind
from experiments.dataset.records import COUNTING, EVERY, Dataset, SessionRecord
from experiments.definition.plan import StudyPlan
from experiments.definition.schema import StudyDefinition

PEOPLE: Sequence[Kind] = ("participant",)
_NO_TEST = "No test could be computed: there are too few cases."


@dataclass(frozen=True)
class Report:
    """The report on a selection of drives. `problems` are the rules that records fail, by session;
    `titles` are those of conditions, by key; `decisions` are the hypotheses on which declared tests
    decide, none in a sensitivity analysis; `note` says what participants are, if not participants
    alone.
    """

    name: str
    tables: tuple[Table, ...]
    figures: tuple[Drawing, ...]
    measured: tuple[Measured, ...]
    others: tuple[Measured, ...]
    problems: dict[str, summaries.Problems]
    titles: dict[str, str]
    alpha: float
    decisions: Decisions = field(default_factory=dict)
    note: str = ""


def reports(dataset: Dataset, kinds: Sequence[Kind] = PEOPLE) -> Iterator[Report]:
    """Yield the report on what counts and, if something is excluded, the sensitivity analysis."""
    planned, every = counting(dataset, kinds), counting(dataset, kinds, with_excluded=True)
    task_drives = replace(planned, sessions=(*planned.sessions, *planned.others), others=())
    measured = {one.session.id: one for one in measure_all(task_drives)}
    if _used(planned) == _used(every):
        yield report(planned, measured, dataset)
        return
    tested = [declared(one, _measured(attempted(one), measured)) for one in (planned, every)]
    changed = hypotheses.exclusion_effects(tested[0], tested[1], alpha_of(dataset.study))
    yield report(planned, measured, dataset, changed)
    yield report(every, measured, dataset)


def _used(dataset: Dataset) -> set[str]:
    """Return the participants and drives, by id, that are behind the numbers of a report."""
    people = {one.id for one in dataset.included}
    return people | {one.id for one in (*dataset.sessions, *attempted(dataset))}


def alpha_of(study: StudyDefinition) -> float:
    return (study.plan or StudyPlan()).alpha


def _measured(sessions: Sequence[SessionRecord], found: Mapping[str, Measured]) -> list[Measured]:
    return [replace(found[one.id], session=one) for one in sessions]


def report(
    dataset: Dataset, numbers: Mapping[str, Measured], whole: Dataset, *also: Table
) -> Report:
    """Return the report on a dataset of what counts, which was chosen from `whole`. `numbers` are
    the drives as measured, by session; `also` has more tables on exclusions.
    """
    measured, others = (_measured(some, numbers) for some in (dataset.sessions, dataset.others))
    quality = dataset.study.quality
    problems = {one.session.id: summaries.problems_of(one, quality) for one in (*measured, *others)}
    attempts = _measured(attempted(dataset), numbers)
    study, tested = dataset.study, declared(dataset, attempts)
    is_sensitivity = dataset.is_with_excluded
    decisions = [] if is_sensitivity else hypotheses.decisions_of(study, tested)
    tables = [*_tables(dataset, measured, others, attempts, problems), *tested]
    if not is_sensitivity:
        sheet = reporting_sheet(dataset, measured, whole.participants)
        tables += [hypotheses.hypotheses_table(study, decisions), *also]
        tables.append(success_sensitivity(dataset, attempts, alpha_of(study)))
        tables += [hypotheses.exclusions_table(dataset.exclusions), sheet]
    tables = [hypotheses.marked_table(one, is_sensitivity=is_sensitivity) for one in tables]
    marked = partial(hypotheses.marked_figure, study, is_sensitivity=is_sensitivity)
    who = dataset.participants
    notes = (people.kinds_note(who), hypotheses.SENSITIVITY if is_sensitivity else "")
    return Report(
        name=EVERY if is_sensitivity else COUNTING,
        tables=(*(people.label_kinds(one, who) for one in tables), software_table()),
        figures=tuple(label_figure(marked(one), who) for one in _figures(dataset, measured)),
        measured=tuple(measured),
        others=tuple(others),
        problems=problems,
        titles={one.key: dataset.say(one.title) or one.key for one in study.conditions},
        alpha=alpha_of(study),
        decisions=hypotheses.by_row(decisions),
        note=" ".join(filter(None, notes)),
    )


def _tables(
    dataset: Dataset,
    measured: Sequence[Measured],
    others: Sequence[Measured],
    attempts: Sequence[Measured],
    problems: Mapping[str, summaries.Problems],
) -> Iterator[Table]:
    conditions = [one.key for one in dataset.study.conditions]
    all_drives = (*measured, *others)
    yield from (paper_tables.table_1(dataset), people.table_2(dataset))
    yield from (paper_tables.table_3(dataset), paper_tables.table_4(dataset))
    for condition in (None, *(conditions if conditions[1:] else ())):
        yield paper_tables.table_5(dataset, condition)
    yield from (people.participants_table(dataset), flow.flow(dataset), flow.orders(dataset))
    yield from (flow.funnel(dataset, all_drives), summaries.metrics_table(measured))
    yield summaries.segment_spreads(measured)
    yield from (summaries.sessions_table(all_drives, problems), summaries.segments_table(measured))
    yield summaries.verdicts_table(measured, problems, others)
    yield from (flow.fault_sides(dataset), effects.outcomes_by_condition(dataset, attempts))
    yield effects.compare_conditions(dataset, attempts)
    yield paper_tables.compare_answers(dataset)
    yield from (*score_tables(dataset), reliability_table(dataset))
    yield from (effects.against_network(measured), effects.by_network(measured))
    yield from (delays.ages(dataset, measured), delays.safety_limits(dataset, measured))
    yield from (effects.learning(measured), effects.learnt(dataset, measured))


def _figures(dataset: Dataset, measured: Sequence[Measured]) -> Iterator[Drawing]:
    for site in dict.fromkeys(course.site for course in dataset.study.courses):
        yield figure_6(dataset, site)
    yield figure_7(dataset, measured)
    yield figure_8a(dataset)
    yield figure_8b(dataset)
    yield from score_figures(dataset)


Also = Callable[[Report, Path], None]


def analyse(
    dataset: Dataset, folder: Path, kinds: Sequence[Kind] = PEOPLE, also: Also | None = None
) -> list[Path]:
    """Write the reports on a dataset into a folder, which is made; return what was written, the
    sums last.

    What `also` writes into the folder of each report is no part of the sums. It is for a page,
    which has no use for the PNGs: to draw them takes longer than everything else.
    """
    written: list[Path] = []
    for one in reports(dataset, kinds):
        written += write(one, folder / one.name, png=also is None)
        if also is not None:
            also(one, folder / one.name)
    lines = [
        f"{sha256(path.read_bytes()).hexdigest()}  {path.relative_to(folder).as_posix()}"
        for path in sorted(written)
    ]
    sums = folder / "SHA256SUMS"
    sums.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="")
    return [*sorted(written), sums]


def write(found: Report, folder: Path, *, png: bool = True) -> Iterator[Path]:
    """Write a report into a folder, and yield each file once it is written."""
    for name, content in _files(found, png=png):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
        yield path


def _files(found: Report, *, png: bool) -> Iterator[tuple[str, bytes]]:
    for table in found.tables:
        yield f"tables/{table.name}.csv", as_csv(table).encode()
        yield f"tables/{table.name}.tex", as_latex(table).encode()
        yield f"tables/{table.name}.docx", table_document(table)
    for drawing in found.figures:
        yield f"figures/{drawing.name}.svg", as_svg(drawing)
        yield f"figures/{drawing.name}.pdf", as_pdf(drawing)
        if png:
            yield f"figures/{drawing.name}.png", as_png(drawing)
        yield f"figures/{drawing.name}.csv", as_csv(drawing.numbers).encode()
    for kind, content in _results(found).items():
        yield f"results.{kind}", content
    yield "sources.json", json.dumps(sources(found), indent=1).encode() + b"\n"


def _results(found: Report) -> dict[str, bytes]:
    """Return the sentences on all tests, by kind of file: those that decide on hypotheses first."""
    text, tex, paragraphs = list[str](), list[str](), list[tuple[Run, ...]]()
    for title, sentences in _sections(found):
        text += [title, *(one.text for one in sentences), ""]
        bold = rf"\paragraph{{{latex(title)}}}"
        tex += [bold, *(f"{runs_as_latex(one.runs)}\n" for one in sentences)]
        paragraphs += [(Run(title, italic=True),), *(one.runs for one in sentences)]
    if not text:
        text, tex, paragraphs = [_NO_TEST], [_NO_TEST], [(Run(_NO_TEST),)]
    if found.note:
        text[:0], tex[:0] = [found.note, ""], [f"{latex(found.note)}\n"]
        paragraphs[:0] = [(Run(found.note),)]
    return {
        "txt": "".join(f"{line}\n" for line in text).encode(),
        "tex": "".join(f"{line}\n" for line in tex).encode(),
        "docx": text_document(paragraphs),
    }


def _sections(found: Report) -> Iterator[tuple[str, list[Sentence]]]:
    status = "sensitivity analysis" if found.name == EVERY else "exploratory"
    sentences = [
        (table.title.removesuffix("."), one)
        for table in found.tables
        for one in sentences_of(table, found.alpha, found.decisions)
    ]
    planned = sorted((one for _, one in sentences if one.hypothesis), key=lambda it: it.hypothesis)
    if planned:
        yield "Hypotheses of the plan.", planned
    for title in dict.fromkeys(title for title, _ in sentences):
        own = [one for other, one in sentences if other == title and not one.hypothesis]
        if own:
            yield f"{title} ({status}).", own


def sources(found: Report) -> dict[str, Any]:
    """Return the sessions behind every cell and every part of a figure, by their set's number."""
    sets = SessionSets()
    tables = {
        table.name: [[sets.number(cell.sessions) for cell in row] for row in table.rows]
        for table in found.tables
        if table.name not in {"sessions", "segments"}  # a row of these names its session
    }
    figures = {
        drawing.name: {gid: sets.number(ids) for gid, ids in drawing.behind.items()}
        for drawing in found.figures
    }
    stored = [list(ids) for ids in sets]
    return {"metrics_version": VERSION, "sets": stored, "tables": tables, "figures": figures}
