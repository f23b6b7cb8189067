"""The numbers of sessions as a table of a dataset: what the analysis makes of the states, with the
version of its definitions.
"""

import math
from collections.abc import Iterable
from typing import Any

from experiments.analysis.dataset.columns import Column
from experiments.analysis.dataset.records import Dataset, EventRecord, SessionRecord
from experiments.analysis.metrics.definitions import METRICS, VERSION
from experiments.analysis.metrics.sessions import measure
from experiments.analysis.tables.reliability import judge

METRIC_TABLE = (
    Column("session", "", "code of the session"),
    Column("metrics_version", "", "version of the definitions of the numbers"),
    Column(
        "problems",
        "",
        "rules for the record's quality that are not kept, divided by |; empty: good",
    ),
    *METRICS,
)


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
        *("" if math.isnan(value) else repr(value) for value in values),
    ]
