"""The dataset itself (experiments/analysis/dataset/folder.py) and the metrics of every session: as
CSV, and as JSON what is no table.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from experiments.analysis.dataset.files import numbers, table, tables
from experiments.analysis.dataset.records import SessionRecord
from experiments.analysis.tables.metric_rows import METRIC_TABLE, metric_row
from experiments.dataset.build import ANALYSED
from experiments.dataset.events import events_of
from experiments.dataset.selection import Selection
from experiments.export.format import ExportFormat, ExportSource, File, encoded
from experiments.models import Drive


class CsvFormat(ExportFormat):
    """What every export has."""

    tables = {"metrics": METRIC_TABLE}

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
