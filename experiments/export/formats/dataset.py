"""The dataset itself (experiments/dataset/folder.py) and the metrics of every session."""

from collections.abc import Iterator
from typing import Any

from experiments.analysis.metrics.definitions import METRICS, VERSION
from experiments.analysis.metrics.sessions import Measured
from experiments.analysis.tables.summaries import problems_of
from experiments.dataset.columns import Column
from experiments.dataset.files import numbers, tables
from experiments.dataset.levels import FAULTS
from experiments.dataset.records import SessionRecord
from experiments.definition.schema import Quality
from experiments.export.format import ExportFormat, ExportSource, File
from experiments.extraction.allow_list import event_columns
from experiments.extraction.events import events_of
from experiments.models import Drive

METRIC_TABLE = (
    Column("session", "", "code of the session"),
    Column("metrics_version", "", "version of the definitions of the numbers"),
    Column(
        "problems",
        "",
        "rules for the record's quality that are not kept; empty: good",
        levels=FAULTS,
        divider="|",
    ),
    *METRICS,
)


class DatasetFormat(ExportFormat):
    tables = {"metrics": METRIC_TABLE, "events": event_columns()}

    def of_study(self) -> Iterator[File]:
        one = self.source
        yield from tables(one.dataset, events_of(one.drives, one.release), one.more)

    def of_session(self, session: SessionRecord, drive: Drive) -> Iterator[File]:
        dataset = self.source.dataset
        yield from numbers("states", session.id, dataset.states(session.id))
        yield from numbers("network", session.id, dataset.network(session.id))

    def at_last(self) -> Iterator[File]:
        yield self.source.table("metrics", metric_rows(self.source))


def metric_rows(source: ExportSource) -> Iterator[list[Any]]:
    quality = source.dataset.study.quality
    return (metric_row(one, quality) for one in source.measured.values())


def metric_row(measured: Measured, quality: Quality) -> list[Any]:
    problems = "|".join(problems_of(measured, quality))
    numbers = (measured.values[column.name] for column in METRICS)
    return [measured.session.id, VERSION, problems, *numbers]
