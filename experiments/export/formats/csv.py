"""The dataset itself (experiments/analysis/dataset/folder.py) and the metrics of every session: as
CSV, and as JSON what is no table.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

from experiments.analysis.dataset.cells import as_cell
from experiments.analysis.dataset.columns import Column
from experiments.analysis.dataset.files import numbers, table, tables
from experiments.analysis.dataset.records import Dataset, EventRecord, SessionRecord
from experiments.analysis.metrics.definitions import METRICS, VERSION
from experiments.analysis.metrics.sessions import measure
from experiments.analysis.tables.reliability import PROBLEMS, judge
from experiments.dataset.allow_list import event_columns
from experiments.dataset.build import ANALYSED
from experiments.dataset.events import events_of
from experiments.dataset.selection import Selection
from experiments.export.format import ExportFormat, ExportSource, File, encoded
from experiments.models import Drive

METRIC_TABLE = (
    Column("session", "", "code of the session"),
    Column("metrics_version", "", "version of the definitions of the numbers"),
    Column(
        "problems",
        "",
        "rules for the record's quality that are not kept; empty: good",
    ).some_of(PROBLEMS),
    *METRICS,
)


class CsvFormat(ExportFormat):
    """What every export has."""

    tables = {"metrics": METRIC_TABLE, "events": event_columns()}

    @classmethod
    def is_in(cls, _name: str, _choice: Selection) -> bool:
        """Tell that every export has it."""
        return True

    def __init__(self, source: ExportSource) -> None:
        super().__init__(source)
        self._metrics: list[list[Any]] = []

    def of_study(self) -> Iterator[File]:
        """Yield everything but states and network samples."""
        one = self.source
        events = events_of(one.drives, one.release)
        yield from encoded(tables(one.dataset, events, one.more))

    def of_session(self, session: SessionRecord, drive: Drive) -> Iterator[File]:
        """Yield states and network samples."""
        dataset = self.source.dataset
        yield from encoded(numbers("states", session.id, dataset.states(session.id)))
        yield from encoded(numbers("network", session.id, dataset.network(session.id)))
        events = events_of([drive], replace(self.source.release, choice=ANALYSED))
        self._metrics.append(metric_row(dataset, session, events))

    def at_last(self) -> Iterator[File]:
        """Yield the metrics of all sessions."""
        yield from encoded([table("metrics", self._metrics, METRIC_TABLE)])


def metric_row(
    dataset: Dataset, session: SessionRecord, events: Iterable[EventRecord]
) -> list[Any]:
    """Return the row of a session, from its own events."""
    measured = measure(dataset, session, events)
    problems = "|".join(word for word, _ in judge(measured, dataset.study.quality).problems)
    values = (measured.values[column.name] for column in METRICS)
    return [
        session.id,
        VERSION,
        problems,
        *(as_cell(value) for value in values),
    ]
