"""A dataset as files: names and texts, made one after the other, so that they can be written into a
folder or sent as they are made.

Numbers are written with as many digits as they have, so that reading gives the same ones.
"""

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice
from types import MappingProxyType
from typing import Any

import msgspec
import numpy as np

from experiments.analysis.dataset import columns
from experiments.analysis.dataset.cells import EXACT, as_cell
from experiments.analysis.dataset.code_book import description
from experiments.analysis.dataset.columns import Column
from experiments.analysis.dataset.names import (
    DatasetError,
    numbers_path,
    plan_path,
    table_path,
)
from experiments.analysis.dataset.records import (
    Columns,
    Dataset,
    EventRecord,
    Floats,
    PageRecord,
    ParticipantRecord,
    ResponseRecord,
    SessionRecord,
)
from experiments.analysis.dataset.wide import wide_tables
from experiments.definition.schema import to_json as study_json
from robots.api import floorplan
from robots.files.csv_text import csv_text
from surveys.definition import to_json

File = tuple[str, Iterable[str]]  # where in the folder, and its text in parts
LINES_AT_ONCE = 500


def contents(dataset: Dataset) -> Iterator[File]:
    """Yield the files of a dataset.

    Raises:
        DatasetError: a code that cannot be the name of a file, or two that would have the same.
    """
    yield from tables(dataset, dataset.events)
    for session in dataset.sessions:
        yield from numbers("states", session.id, dataset.states(session.id))
        yield from numbers("network", session.id, dataset.network(session.id))


def tables(
    dataset: Dataset,
    events: Iterable[EventRecord],
    more: Mapping[str, tuple[Column, ...]] = MappingProxyType({}),
) -> Iterator[File]:
    """Yield everything but states and network samples.

    Args:
        dataset: what is to be written.
        events: its events, which may be too many to be held.
        more: columns of tables that somebody else writes beside these, for the code book.

    Raises:
        DatasetError: two sessions with codes that would have the same file.
    """
    if len({one.id.replace("-", "") for one in dataset.sessions}) < len(dataset.sessions):
        raise DatasetError("two sessions have codes that differ only in hyphens")
    yield from about(dataset, more)
    yield table("participants", (cells(one, columns.PARTICIPANTS) for one in dataset.participants))
    yield table("sessions", (cells(one, columns.SESSIONS) for one in dataset.sessions))
    yield table("events", (cells(one, columns.EVENTS) for one in events))
    yield table("pages", (cells(one, columns.PAGES) for one in dataset.pages))
    yield table("answers", (row for one in dataset.responses for row in answer_rows(one)))
    for path, head, rows in wide_tables(dataset):
        yield path, lines(head, rows)


def about(dataset: Dataset, more: Mapping[str, tuple[Column, ...]]) -> Iterator[File]:
    """Yield what does not grow with the sessions: description, study, robots, plans and
    questionnaires.
    """
    yield (
        "dataset_description.json",
        [json.dumps(description(dataset, more), indent=2, ensure_ascii=False) + "\n"],
    )
    yield "study.json", [study_json(dataset.study).decode()]
    if dataset.freeze is not None:
        freeze = msgspec.json.format(msgspec.json.encode(dataset.freeze), indent=2)
        yield "freeze.json", [freeze.decode() + "\n"]
    yield (
        "robots.json",
        [msgspec.json.format(msgspec.json.encode(dataset.robots), indent=2).decode() + "\n"],
    )
    for name, plan in sorted(dataset.plans.items()):
        yield plan_path(name), [floorplan.encode(plan).decode() + "\n"]
    for one in dataset.questionnaires:
        yield f"questionnaires/{one.slug}-{one.version}.json", [to_json(one).decode()]


# --- tables ---------------------------------------------------------------------------------------


def table(name: str, rows: Iterable[Sequence[Any]], layout: tuple[Column, ...] = ()) -> File:
    """Return a table as a file; one that is not among TABLES needs its layout."""
    return table_path(name), lines([column.name for column in layout or columns.TABLES[name]], rows)


def lines(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> Iterator[str]:
    """Yield rows as CSV, some at a time; none of their cells is a formula."""
    yield csv_text([head])
    rest = iter(rows)
    while some := list(islice(rest, LINES_AT_ONCE)):
        yield csv_text(some)


def cells(
    record: ParticipantRecord | SessionRecord | EventRecord | PageRecord, layout: tuple[Column, ...]
) -> list[Any]:
    """Return the cells of a record in the order of its columns."""
    return [as_cell(getattr(record, column.name)) for column in layout]


def answer_rows(response: ResponseRecord) -> Iterator[list[Any]]:
    """Yield a row an item of a response; a response without items keeps one row without an item."""
    own = [
        response.id,
        response.questionnaire,
        response.version,
        response.participant,
        response.session,
        as_cell(response.finished),
    ]
    for item in dict.fromkeys((*response.values, *response.missing)) or [""]:
        value = response.values.get(item)
        said = "" if value is None else json.dumps(value, ensure_ascii=False)
        yield [
            *own,
            item,
            said,
            response.missing.get(item, ""),
            as_cell(response.seconds.get(item, math.nan)),
        ]


# --- numbers --------------------------------------------------------------------------------------


def numbers(name: str, session: str, found: Columns) -> Iterator[File]:
    """Yield the file of the states or network samples of a session; none is no file."""
    if len(found):
        head = ",".join(column.name for column in found.layout)
        rows = list(zip(*map(_written, np.ascontiguousarray(found.values.T)), strict=True))
        # some five times as fast as by Python's own repr
        lines = msgspec.json.encode(rows)[2:-2].replace(b"],[", b"\n").replace(b"null", b"nan")
        yield numbers_path(name, session), [f"{head}\n{lines.decode()}\n"]


def _written(column: Floats) -> list[float]:
    """A column as numbers that JSON writes as a reader expects: whole ones without a point."""
    # neither holds for what is no number
    is_whole = bool((column == np.trunc(column)).all() and (np.abs(column) < EXACT).all())
    written: list[float] = (column.astype(np.int64) if is_whole else column).tolist()
    return written
