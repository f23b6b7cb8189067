"""Everything at once: a folder of tables and figures from a dataset, and nothing else, so that the
same dataset gives the same bytes.

    <selection>/tables/<name>.csv, .tex, .docx         every number and what it is made of
    <selection>/figures/<name>.svg, .pdf, .png, .csv   every figure and its numbers
    <selection>/results.txt, .tex, .docx               every test as a sentence
    <selection>/sources.json                           which sessions are behind every cell, bar and
                                                       trajectory
    SHA256SUMS                                         of all of these

A selection is `all`, or `without-excluded` where a researcher has excluded sessions.
"""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

from experiments.analysis.dataset.levels import Kind
from experiments.analysis.dataset.records import EVERY, WITHOUT, Dataset
from experiments.analysis.documents.latex import as_latex, latex, runs_as_latex
from experiments.analysis.documents.runs import Run
from experiments.analysis.documents.sentences import sentences_of
from experiments.analysis.documents.word import table_document, text_document
from experiments.analysis.figures.drawing import Drawing, as_pdf, as_png, as_svg, drawn_of_whom
from experiments.analysis.figures.opinions import figure_8a, figure_8b
from experiments.analysis.figures.scores import score_figures
from experiments.analysis.figures.trajectories import figure_6, figure_7
from experiments.analysis.metrics.definitions import VERSION
from experiments.analysis.metrics.sessions import Measured, measure_all
from experiments.analysis.plan.exclusions import (
    excluded_participants,
    exclusions,
    exclusions_table,
)
from experiments.analysis.plan.hypotheses import hypotheses_table, marked_figure, marked_table
from experiments.analysis.plan.reporting_sheet import reporting_sheet
from experiments.analysis.plan.sensitivity import ALPHA, exclusion_effects
from experiments.analysis.tables.ages import ages
from experiments.analysis.tables.answers import compare_answers
from experiments.analysis.tables.declared import declared
from experiments.analysis.tables.effects import (
    against_network,
    by_network,
    compare_conditions,
    learning,
    learnt,
    outcomes_by_condition,
)
from experiments.analysis.tables.flow import fault_sides, flow, funnel
from experiments.analysis.tables.paper_tables import table_1, table_3, table_4, table_5
from experiments.analysis.tables.participant_kinds import note_of, of_whom
from experiments.analysis.tables.people import participants_table, table_2
from experiments.analysis.tables.reliability import QualityVerdict, judge
from experiments.analysis.tables.safety_limits import safety_limits
from experiments.analysis.tables.scale_reliability import reliability_table
from experiments.analysis.tables.scores import score_tables
from experiments.analysis.tables.software import software_table
from experiments.analysis.tables.summaries import (
    metrics_table,
    segment_spreads,
    segments_table,
    sessions_table,
    verdicts_table,
)
from experiments.analysis.tables.table import Table, as_csv

_NO_TEST = "No test could be computed: there are too few cases."


@dataclass(frozen=True)
class Report:
    """The tables and figures of a selection of sessions, with the sessions' numbers, those of
    sessions that count nowhere by rule, the verdicts on their records, and what each condition is
    called, by its key. `note` tells of whom it is where that is not participants alone.
    """

    name: str
    tables: tuple[Table, ...]
    figures: tuple[Drawing, ...]
    measured: tuple[Measured, ...]
    ruled_out: tuple[Measured, ...]
    verdicts: dict[str, QualityVerdict]
    titles: dict[str, str]
    note: str = ""


def reports(dataset: Dataset, kinds: Sequence[Kind] = ("participant",)) -> Iterator[Report]:
    """Yield the report on all sessions that count, and the one without the excluded ones where
    there are any.
    """
    every = dataset.chosen(kinds)
    measured = measure_all(every)
    ruled_out = measure_all(replace(dataset, sessions=every.ruled_out))
    found = exclusions(every)
    left_out = excluded_participants(found)
    sheet = reporting_sheet(every, measured, found, dataset.participants)
    about = (exclusions_table(found), sheet)
    if not left_out and not any(session.excluded for session in every.sessions):
        yield report(EVERY, every, measured, ruled_out, also=about)
        return
    without = dataset.chosen(kinds, with_excluded=False).without(left_out)
    kept_ids = {one.id for one in without.sessions}
    kept = [one for one in measured if one.session.id in kept_ids]
    plan = dataset.study.plan
    alpha = ALPHA if plan is None else plan.alpha
    effects = exclusion_effects(declared(every, measured), declared(without, kept), alpha)
    yield report(EVERY, every, measured, ruled_out, also=(effects, *about))
    yield report(WITHOUT, without, kept, ruled_out, also=(effects, *about))


def report(
    name: str,
    dataset: Dataset,
    measured: Sequence[Measured],
    ruled_out: Sequence[Measured] = (),
    also: Sequence[Table] = (),
) -> Report:
    """Return the tables and figures of a dataset whose sessions were measured, with the tables of
    `also`, which are about all of them.
    """
    verdicts = {
        one.session.id: judge(one, dataset.study.quality) for one in (*measured, *ruled_out)
    }
    people = dataset.participants
    tables = tuple(
        of_whom(marked_table(dataset.study, table), people)
        for table in (*_tables(dataset, measured, ruled_out, verdicts), *also)
    )
    figures = tuple(
        drawn_of_whom(marked_figure(dataset.study, one), people)
        for one in _figures(dataset, measured)
    )
    titles = {one.key: dataset.say(one.title) or one.key for one in dataset.study.conditions}
    return Report(
        name,
        (*tables, software_table()),
        figures,
        tuple(measured),
        tuple(ruled_out),
        verdicts,
        titles,
        note_of(people),
    )


def _tables(
    dataset: Dataset,
    measured: Sequence[Measured],
    ruled_out: Sequence[Measured],
    verdicts: Mapping[str, QualityVerdict],
) -> tuple[Table, ...]:
    conditions = [one.key for one in dataset.study.conditions]
    tested = declared(dataset, measured)
    return (
        *(table_1(dataset), table_2(dataset), table_3(dataset), table_4(dataset), table_5(dataset)),
        *(table_5(dataset, key) for key in conditions if len(conditions) > 1),
        *(participants_table(dataset), flow(dataset), funnel(dataset, measured)),
        *(
            metrics_table(measured),
            segment_spreads(measured),
            sessions_table(measured, verdicts),
            segments_table(measured),
        ),
        *(
            verdicts_table(measured, verdicts, ruled_out),
            outcomes_by_condition(dataset, measured),
            fault_sides(dataset),
            compare_conditions(dataset, measured),
        ),
        *(
            compare_answers(dataset),
            *score_tables(dataset),
            reliability_table(dataset),
            against_network(measured),
            by_network(measured),
            ages(dataset, measured),
            safety_limits(dataset, measured),
            learning(measured),
            learnt(measured),
            *tested,
            hypotheses_table(dataset, tested),
        ),
    )


def _figures(dataset: Dataset, measured: Sequence[Measured]) -> Iterator[Drawing]:
    for site in dict.fromkeys(course.site for course in dataset.study.courses):
        yield figure_6(dataset, site)
    yield figure_7(dataset, measured)
    yield figure_8a(dataset)
    yield figure_8b(dataset)
    yield from score_figures(dataset)


Also = Callable[[Report, Path], None]


def analyse(
    dataset: Dataset,
    folder: Path,
    kinds: Sequence[Kind] = ("participant",),
    also: Also | None = None,
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
    for table in found.tables:
        yield _file(folder / "tables" / f"{table.name}.csv", as_csv(table).encode())
        yield _file(folder / "tables" / f"{table.name}.tex", as_latex(table).encode())
        yield _file(folder / "tables" / f"{table.name}.docx", table_document(table))
    for drawing in found.figures:
        yield _file(folder / "figures" / f"{drawing.name}.svg", as_svg(drawing))
        yield _file(folder / "figures" / f"{drawing.name}.pdf", as_pdf(drawing))
        if png:
            yield _file(folder / "figures" / f"{drawing.name}.png", as_png(drawing))
        yield _file(folder / "figures" / f"{drawing.name}.csv", as_csv(drawing.numbers).encode())
    for kind, content in _results(found).items():
        yield _file(folder / f"results.{kind}", content)
    yield _file(folder / "sources.json", json.dumps(sources(found), indent=1).encode() + b"\n")


def _results(found: Report) -> dict[str, bytes]:
    """Return the sentences on all tests below the titles of their tables, by kind of file."""
    text, tex, paragraphs = list[str](), list[str](), list[tuple[Run, ...]]()
    for table in found.tables:
        sentences = list(sentences_of(table))
        if sentences:
            text += [table.title, *(one.text for one in sentences), ""]
            bold = rf"\paragraph{{{latex(table.title)}}}"
            tex += [bold, *(f"{runs_as_latex(one.runs)}\n" for one in sentences)]
            paragraphs += [(Run(table.title, italic=True),), *(one.runs for one in sentences)]
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


def _file(path: Path, content: bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path


def sources(found: Report) -> dict[str, Any]:
    """Return which sessions are behind every cell (table, row, column) and every part of a figure
    (figure, gid).

    Sets of sessions are written once, in `sets`, and named by their place there, because many cells
    share one.
    """
    sets: dict[tuple[str, ...], int] = {}

    def place(sessions: tuple[str, ...]) -> int:
        return sets.setdefault(tuple(dict.fromkeys(sessions)), len(sets))

    tables = {
        table.name: [
            [place(cell.sessions) if cell.sessions else None for cell in row] for row in table.rows
        ]
        for table in found.tables
        if table.name not in {"sessions", "segments"}  # a row of these names its session
    }
    figures = {
        drawing.name: {gid: place(ids) for gid, ids in drawing.behind.items()}
        for drawing in found.figures
    }
    return {
        "metrics_version": VERSION,
        "sets": [list(ids) for ids in sets],
        "tables": tables,
        "figures": figures,
    }
