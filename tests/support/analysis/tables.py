"""Sessions with made-up numbers, from which tables are made, and readers of tables."""

import math

import numpy as np

from experiments.analysis.metrics.definitions import METRICS
from experiments.analysis.metrics.milestones import Milestones
from experiments.analysis.metrics.sessions import Measured
from experiments.analysis.tables.table import Row, Table, TableCell
from experiments.dataset.records import SessionRecord


def measured(session: SessionRecord, **values: float) -> Measured:
    """A session with these metrics; the others are unknown (NaN)."""
    unknown = {column.name: math.nan for column in METRICS}
    return Measured(session, Milestones(), unknown | values, (), np.empty((0, 2)))


def rows(table: Table, *heads: str) -> list[tuple[str, ...]]:
    """The texts of some columns, row by row."""
    columns = [table.head.index(head) for head in heads]
    return [tuple(row[column].text for column in columns) for row in table.rows]


def value(table: Table, row: int, head: str) -> float | None:
    return table.rows[row][table.head.index(head)].value


def cells(table: Table, row: Row) -> dict[str, TableCell]:
    """The cells of a row by the heads of their columns."""
    return dict(zip(table.head, row, strict=True))


def row_of(table: Table, **wanted: str) -> dict[str, TableCell]:
    """The cells of the only row that has these texts in these columns."""
    found = [cells(table, row) for row in table.rows]
    (row,) = (one for one in found if all(one[head].text == text for head, text in wanted.items()))
    return row


def labelled(table: Table) -> dict[str, Row]:
    """The rows by the text of their first cell."""
    return {row[0].text: row for row in table.rows}
