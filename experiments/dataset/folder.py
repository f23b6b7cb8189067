"""A dataset as a folder of CSV and JSON files, named and described as Psych-DS requires: written,
and read without a difference.

    dataset_description.json            the code book: every column of every file
    study.json                          the study as it was published
    freeze.json                         when it was published, and whether before the data
    robots.json                         its robots
    plans/<site>.json                   floor plans
    questionnaires/<name>-<n>.json      definitions, a file a version
    data/description-…_data.csv         participants, sessions, events, pages, answers
    data/questionnaire-…_data.csv       answers again, a line a response, with scores; never read
    data/states/session-…_data.csv      states of a session; data/network likewise

No more than one session's states is ever in memory.
"""

import csv
import io
import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, get_type_hints

import msgspec
import numpy as np

from experiments.dataset.columns import Column, Columns, columns_of, declared
from experiments.dataset.files import DatasetError, File, contents, numbers_path, table_path
from experiments.dataset.grouping import by_key
from experiments.dataset.records import (
    TABLES,
    AnswerRecord,
    Dataset,
    FreezeRecord,
    ResponseRecord,
    RobotRecord,
)
from experiments.dataset.states import NETWORK, STATES
from experiments.definition.publication import PublicationDetails, from_json_ld
from experiments.definition.schema import StudyDefinition
from robots.api import floorplan
from robots.api.floorplan import FloorPlan, FloorPlanError
from robots.files.csv_text import unguarded
from surveys.definition import Definition

__all__ = ["DatasetError", "put", "read", "read_numbers", "write"]


def write(dataset: Dataset, folder: Path) -> None:
    """Write a dataset into a folder, which is made; raises as `contents` does."""
    for file in contents(dataset):
        put(file, folder)


def put(file: File, folder: Path) -> None:
    name, parts = file
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", encoding="utf-8", newline="") as out:
        out.writelines(parts)


def read(folder: Path) -> Dataset:
    """Return a folder's dataset, or raise DatasetError. States are read on each call."""
    definitions = sorted((folder / "questionnaires").glob("*.json"))
    plans, freeze = sorted((folder / "plans").glob("*.json")), folder / "freeze.json"
    return Dataset(
        study=_decoded(folder / "study.json", StudyDefinition),
        robots=_decoded(folder / "robots.json", tuple[RobotRecord, ...]),
        participants=_records(folder, "participants"),
        sessions=_records(folder, "sessions"),
        events=_records(folder, "events"),
        pages=_records(folder, "pages"),
        responses=tuple(_responses(_records(folder, "answers"))),
        questionnaires=tuple(_decoded(path, Definition) for path in definitions),
        plans={path.stem: _decoded(path, FloorPlan) for path in plans},
        states=lambda session: read_numbers(folder, "states", session, STATES),
        network=lambda session: read_numbers(folder, "network", session, NETWORK),
        freeze=_decoded(freeze, FreezeRecord) if freeze.exists() else None,
        publication=_publication(folder / "dataset_description.json"),
    )


def _publication(path: Path) -> PublicationDetails:
    try:
        return from_json_ld(_decoded(path, dict[str, Any]))
    except (AttributeError, KeyError, TypeError) as error:
        raise DatasetError(f"{path.name} has publication details of another form") from error


def read_numbers(folder: Path, name: str, session: str, layout: tuple[Column, ...]) -> Columns:
    """Return the states or network samples of a session, which has none without a file. Late
    columns that an older file lacks are NaN; other unexpected columns, and a cell that is no
    number, are a DatasetError.
    """
    path = folder / numbers_path(name, session)
    if not path.exists():
        return columns_of(layout)
    with path.open(encoding="utf-8") as file:
        names = _columns_in(path, file.readline().strip().split(","), layout)
        try:
            found = np.loadtxt(file, delimiter=",", ndmin=2).T
            return columns_of(layout, **dict(zip(names, found, strict=True)))
        except ValueError as error:
            what = "a cell that is not a number, or a line that is too short or too long"
            raise DatasetError(f"{path.name} has {what}") from error


def _columns_in(path: Path, head: Sequence[str], layout: tuple[Column, ...]) -> list[str]:
    """Return the present names of the columns of a file."""
    old = {column.was: column.name for column in layout if column.was}
    names = [old.get(name, name) for name in head]
    lacking = {column.name for column in layout if not column.late} - set(names)
    if lacking:
        raise DatasetError(f"{path.name} lacks the columns {', '.join(sorted(lacking))}")
    unknown = set(names) - {column.name for column in layout}
    if unknown or len(set(names)) < len(names):
        raise DatasetError(f"{path.name} has unexpected columns: {', '.join(names)[:200]}")
    return names


def _records(folder: Path, name: str) -> tuple[Any, ...]:
    kind = TABLES[name]
    layout, kinds = declared(kind), get_type_hints(kind)
    found = []
    for row in _rows(folder / table_path(name), layout):
        try:
            # properties of the record are columns too, which are not read
            known = {name: _value(cell, kinds[name]) for name, cell in row.items() if name in kinds}
            found.append(kind(**known))
        except (ValueError, TypeError) as error:
            some = dict(list(row.items())[:3])
            raise DatasetError(f"{table_path(name)}: {error} in {some}") from error
    return tuple(found)


def _rows(path: Path, layout: tuple[Column, ...]) -> Iterator[dict[str, str]]:
    try:
        text = path.read_bytes().decode()
    except (OSError, UnicodeDecodeError) as error:
        raise DatasetError(f"{path.name} cannot be read: {error}") from error
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        names = _columns_in(path, next(reader, []), layout)
        for row in reader:
            if len(row) != len(names):
                where = f"{path.name}, line {reader.line_num}"
                raise DatasetError(f"{where}: too few or too many cells")
            yield dict(zip(names, map(unguarded, row), strict=True))
    except csv.Error as error:
        raise DatasetError(f"{path.name}, line {reader.line_num}: {error}") from error


def _value(cell: str, kind: Any) -> Any:
    if kind is int:
        return int(cell)
    if kind is bool:
        return bool(int(cell))
    if kind is float:
        return float(cell) if cell else math.nan
    if kind == tuple[str, ...]:
        return tuple(cell.split("|")) if cell else ()
    return json.loads(cell) if kind == Mapping[str, Any] else cell


def _responses(answers: Iterable[AnswerRecord]) -> Iterator[ResponseRecord]:
    for code, rows in by_key((one.response, one) for one in answers).items():
        try:
            yield ResponseRecord.of(rows)
        except ValueError as error:
            raise DatasetError(f"{table_path('answers')}: response {code}: {error}") from error


def _decoded(path: Path, kind: Any) -> Any:
    try:
        content = path.read_bytes()
        is_plan = kind is FloorPlan
        return floorplan.decode(content) if is_plan else msgspec.json.decode(content, type=kind)
    except (OSError, msgspec.DecodeError, UnicodeDecodeError, FloorPlanError) as error:
        raise DatasetError(f"{path.name} cannot be read: {error}") from error
