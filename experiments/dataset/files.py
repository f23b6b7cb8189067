"""A dataset as files: names and texts, made one after the other, so that they can be written into a
folder or sent as they are made. Numbers have all their digits, so that reading gives the same ones.

Psych-DS requires names of pairs: a keyword of lower-case letters and an alphanumeric value, then
`_data.csv`.
"""

import json
import math
import re
import unicodedata
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from itertools import islice
from types import MappingProxyType
from typing import Any

import msgspec
import numpy as np

from experiments.dataset import code_book
from experiments.dataset.columns import Column, Columns, Floats, Tables
from experiments.dataset.records import TABLES, Dataset, EventRecord
from experiments.definition.schema import to_json as study_json
from robots.api import floorplan
from robots.files.csv_text import csv_text
from surveys.definition import to_json
from surveys.scoring import WideTable

File = tuple[str, Iterable[str]]  # path in the folder, and its text in parts
LINES_AT_ONCE = 500
EXACT = 1e15  # whole numbers below it are exact
DIGEST = 8  # characters of the sum that tells apart names that would be the same
_CODE = re.compile(r"^[A-Za-z0-9-]{1,64}$")
_PLAN = re.compile(r"^[a-z0-9][a-z0-9_-]{0,63}$")
_PARTS = re.compile(r"[^A-Za-z0-9]+")


class DatasetError(ValueError):
    """A folder without a dataset, or with a broken one; names the file and the problem."""


def contents(dataset: Dataset) -> Iterator[File]:
    """Yield the files of a dataset. A code that is no file name is a DatasetError."""
    yield from tables(dataset, dataset.events)
    for session in dataset.sessions:
        yield from numbers("states", session.id, dataset.states(session.id))
        yield from numbers("network", session.id, dataset.network(session.id))


def tables(
    dataset: Dataset, events: Iterable[EventRecord], more: Tables = MappingProxyType({})
) -> Iterator[File]:
    """Yield everything but states and network samples. The events are read as they are written,
    because there may be too many for the memory; `more` are the columns of tables that are written
    in addition to these, for the code book. Two sessions with codes that would have the same file
    are a DatasetError.
    """
    if len({one.id.replace("-", "") for one in dataset.sessions}) < len(dataset.sessions):
        raise DatasetError("two sessions have codes that differ only in hyphens")
    yield from _about(dataset, more)
    for one in data_tables(dataset, events):
        yield one.path, as_csv(one.layout, one.rows)


@dataclass(frozen=True)
class DataTable:
    """A table of values, named after a record's table or a questionnaire."""

    name: str
    path: str
    layout: Sequence[Column]
    rows: Iterable[Sequence[Any]]


def data_tables(dataset: Dataset, events: Iterable[EventRecord] = ()) -> Iterator[DataTable]:
    layouts = dict(code_book.layouts(dataset, {}))
    records: Mapping[str, Iterable[Any]] = {
        "participants": dataset.participants,
        "sessions": dataset.sessions,
        "events": events,
        "pages": dataset.pages,
        "answers": (row for one in dataset.responses for row in one.answers()),
    }
    for name in TABLES:
        rows = values_of(records[name], layouts[name])
        yield DataTable(name, table_path(name), layouts[name], rows)
    for slug, path in questionnaire_paths(one.slug for one in dataset.questionnaires).items():
        yield DataTable(slug, path, layouts[slug], _wide_rows(dataset, slug))


def _wide_rows(dataset: Dataset, slug: str) -> Iterator[list[Any]]:
    """Yield the responses to a questionnaire, a line each, as programs for statistics need them."""
    known = {one.version: one for one in dataset.questionnaires if one.slug == slug}
    table = WideTable([*known.values()])
    for one in dataset.responses:
        if one.questionnaire == slug:
            own = table.row(known.get(one.version), one.values, one.missing)
            about = (one.id, one.version, one.participant, one.session, one.finished, one.step)
            yield [*about, *own]


def _about(dataset: Dataset, more: Tables) -> Iterator[File]:
    series, drives = {"states": dataset.states, "network": dataset.network}, dataset.sessions
    empty = {name for name, read in series.items() if not any(len(read(one.id)) for one in drives)}
    found = code_book.description(dataset, more, empty)
    yield "dataset_description.json", [json.dumps(found, indent=2, ensure_ascii=False) + "\n"]
    yield "study.json", [study_json(dataset.study).decode()]
    if dataset.freeze is not None:
        yield "freeze.json", [_json(dataset.freeze)]
    if dataset.whole is not None:
        yield "whole.json", [_json(dataset.whole)]
    yield "robots.json", [_json(dataset.robots)]
    for name, plan in sorted(dataset.plans.items()):
        yield f"plans/{_named(name, _PLAN)}.json", [floorplan.encode(plan).decode() + "\n"]
    for one in dataset.questionnaires:
        yield f"questionnaires/{one.slug}-{one.version}.json", [to_json(one).decode()]


def _json(value: Any) -> str:
    return msgspec.json.format(msgspec.json.encode(value), indent=2).decode() + "\n"


def as_csv(layout: Sequence[Column], rows: Iterable[Sequence[Any]]) -> Iterator[str]:
    """Yield rows of values as CSV, some at a time; none of their cells is a formula."""
    yield csv_text([[column.name for column in layout]])
    rest = iter(rows)
    while some := list(islice(rest, LINES_AT_ONCE)):
        yield csv_text([map(as_cell, row) for row in some])


def values_of(records: Iterable[Any], layout: Sequence[Column]) -> Iterator[list[Any]]:
    for record in records:
        yield [getattr(record, column.name) for column in layout]


def as_cell(value: Any) -> Any:
    """Return a value as a cell: 0 and 1, all digits of a number, parts between |, JSON."""
    match value:
        case bool():
            return int(value)
        case float():
            if math.isnan(value):
                return ""
            is_exact = value.is_integer() and abs(value) < EXACT
            return str(int(value)) if is_exact else repr(float(value))
        case tuple():
            return "|".join(value)
        case dict():
            return json.dumps(value, ensure_ascii=False, sort_keys=True)
    return value


def numbers(name: str, session: str, found: Columns) -> Iterator[File]:
    """Yield the file of the states or network samples of a session, unless it has none."""
    if len(found):
        names = found.dtype.names or ()
        rows = list(zip(*(_as_json(found[column]) for column in names), strict=True))
        # some five times as fast as by Python's own repr
        lines = msgspec.json.encode(rows)[2:-2].replace(b"],[", b"\n").replace(b"null", b"nan")
        yield numbers_path(name, session), [f"{','.join(names)}\n{lines.decode()}\n"]


def _as_json(column: Floats) -> list[float]:
    """Return the numbers of a column; JSON writes integers without a point, as readers expect."""
    # both comparisons are false for NaN
    is_whole = bool((column == np.trunc(column)).all() and (np.abs(column) < EXACT).all())
    found: list[float] = (column.astype(np.int64) if is_whole else column).tolist()
    return found


# --- names ----------------------------------------------------------------------------------------


def table_path(name: str) -> str:
    return f"data/description-{name}_data.csv"


def numbers_path(name: str, session: str) -> str:
    return f"data/{name}/session-{_named(session, _CODE).replace('-', '')}_data.csv"


def _named(name: str, pattern: re.Pattern[str]) -> str:
    if not pattern.match(name):
        raise DatasetError(f"{name!r} cannot be used as a file name")
    return name


def questionnaire_paths(slugs: Iterable[str]) -> dict[str, str]:
    """Return the path of each questionnaire's answers, a line a response, by its name in order."""
    values = keyword_values(slugs)
    return {slug: f"data/questionnaire-{value}_data.csv" for slug, value in values.items()}


def keyword_values(slugs: Iterable[str]) -> dict[str, str]:
    """Return each name as a value of letters and digits alone, sorted: `nasa-tlx` is `nasaTlx`.
    Values that would be equal, even if case is ignored, and empty ones end with a part of the
    name's SHA-256.
    """
    plain = {slug: _camel(slug) for slug in sorted(set(slugs))}
    shared = [value.casefold() for value in plain.values()]
    for slug, value in plain.items():
        if not value or shared.count(value.casefold()) > 1:
            plain[slug] += sha256(slug.encode()).hexdigest()[:DIGEST]
    return plain


def _camel(slug: str) -> str:
    letters = unicodedata.normalize("NFKD", slug).encode("ascii", "ignore").decode()
    first, *rest = [part for part in _PARTS.split(letters) if part] or [""]
    return first + "".join(part[0].upper() + part[1:] for part in rest)
