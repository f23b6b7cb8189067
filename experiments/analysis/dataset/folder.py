"""A dataset as a folder of CSV and JSON files, named and described as Psych-DS asks for, and
read back without a difference.

    dataset_description.json            what it is, and every column of every file
    study.json                          the study as it was published
    freeze.json                         when it was published, and whether before the data
    robots.json                         its robots
    plans/<site>.json                   floor plans
    questionnaires/<name>-<n>.json      definitions, a file a version
    data/description-…_data.csv         participants, sessions, events, pages, answers
    data/questionnaire-…_data.csv       answers once more, a line a response, with scores; not read
    back data/states/session-…_data.csv      states of a session; data/network likewise

No more than one session's states is ever in memory.
"""

import csv
import io
import json
import math
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from experiments.analysis.dataset import columns
from experiments.analysis.dataset.columns import Column
from experiments.analysis.dataset.files import File, contents
from experiments.analysis.dataset.names import DatasetError, numbers_path, table_path
from experiments.analysis.dataset.records import (
    Columns,
    Dataset,
    EventRecord,
    FreezeRecord,
    PageRecord,
    ParticipantRecord,
    ResponseRecord,
    RobotRecord,
    SessionRecord,
    columns_of,
)
from experiments.definition.publication import PublicationDetails, from_json_ld
from experiments.definition.schema import StudyDefinition
from robots.api import floorplan
from robots.files.csv_text import unguarded
from surveys.definition import Definition

__all__ = ["DatasetError", "put", "read", "read_numbers", "write"]


def write(dataset: Dataset, folder: Path) -> None:
    """Write a dataset into a folder, which is made.

    Raises:
        DatasetError: a code that cannot be the name of a file, or two that would have the same.
    """
    for file in contents(dataset):
        put(file, folder)


def put(file: File, folder: Path) -> None:
    """Write a file into a folder, part by part."""
    name, parts = file
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", encoding="utf-8", newline="") as out:
        out.writelines(parts)


def read(folder: Path) -> Dataset:
    """Return the dataset of a folder; states and network samples are read when they are asked for.

    Raises:
        DatasetError: a file that is missing or broken.
    """
    return Dataset(
        study=_decoded(folder / "study.json", StudyDefinition),
        robots=_decoded(folder / "robots.json", tuple[RobotRecord, ...]),
        participants=tuple(
            _record(ParticipantRecord, row, "participants") for row in _rows(folder, "participants")
        ),
        sessions=tuple(
            _record(SessionRecord, row, "sessions") for row in _rows(folder, "sessions")
        ),
        events=tuple(_record(EventRecord, row, "events") for row in _rows(folder, "events")),
        pages=tuple(_record(PageRecord, row, "pages") for row in _rows(folder, "pages")),
        responses=tuple(_responses(_rows(folder, "answers"))),
        questionnaires=tuple(
            _decoded(path, Definition)
            for path in sorted((folder / "questionnaires").glob("*.json"))
        ),
        plans={path.stem: _plan(path) for path in sorted((folder / "plans").glob("*.json"))},
        states=lambda session: read_numbers(folder, "states", session, columns.STATES),
        network=lambda session: read_numbers(folder, "network", session, columns.NETWORK),
        freeze=_freeze(folder / "freeze.json"),
        publication=_publication(folder / "dataset_description.json"),
    )


def _freeze(path: Path) -> FreezeRecord | None:
    """Return when the study was frozen; None where an earlier release wrote the folder."""
    return _decoded(path, FreezeRecord) if path.exists() else None


def _publication(path: Path) -> PublicationDetails:
    try:
        return from_json_ld(msgspec.json.decode(path.read_bytes(), type=dict[str, Any]))
    except (OSError, msgspec.DecodeError, UnicodeDecodeError) as error:
        raise DatasetError(f"{path.name} cannot be read: {error}") from error
    except (AttributeError, KeyError, TypeError) as error:
        raise DatasetError(f"{path.name} has publication details of another form") from error


def read_numbers(folder: Path, name: str, session: str, layout: tuple[Column, ...]) -> Columns:
    """Return the states or network samples of a session; no file is none, and late columns that an
    older file lacks are NaN.

    Raises:
        DatasetError: other columns than these, or a cell that is no number.
    """
    path = folder / numbers_path(name, session)
    if not path.exists():
        return columns_of(layout)
    with path.open(encoding="utf-8") as file:
        head = file.readline().strip()
        names = head.split(",")
        there = tuple(one for one in layout if not one.late or one.name in names)
        if names != [column.name for column in there]:
            raise DatasetError(f"{path.name} has unexpected columns: {head[:200]}")
        try:
            found = Columns(there, np.loadtxt(file, delimiter=",", ndmin=2))
        except ValueError as error:
            raise DatasetError(
                f"{path.name} has a cell that is not a number, or a line that is too "
                "short or too long"
            ) from error
    return columns_of(layout, **{name: found[name] for name in names})


def _rows(folder: Path, name: str) -> Iterator[dict[str, str]]:
    path = folder / table_path(name)
    try:
        text = path.read_bytes().decode()
    except (OSError, UnicodeDecodeError) as error:
        raise DatasetError(f"{path.name} cannot be read: {error}") from error
    reader = csv.DictReader(io.StringIO(text, newline=""), strict=True)
    lacking = {column.name for column in columns.TABLES[name] if not column.late} - set(
        reader.fieldnames or ()
    )
    if lacking:
        raise DatasetError(f"{path.name} lacks the columns {', '.join(sorted(lacking))}")
    try:
        for row in reader:
            if None in row or None in row.values():
                raise DatasetError(
                    f"{path.name}, line {reader.line_num}: too few or too many cells"
                )
            yield {key: unguarded(cell) for key, cell in row.items()}
    except csv.Error as error:
        raise DatasetError(f"{path.name}, line {reader.line_num}: {error}") from error


def _record(kind: type[Any], row: dict[str, str], name: str) -> Any:
    try:
        return kind(
            **{one.name: _value(row[one.name], one.type) for one in fields(kind) if one.name in row}
        )
    except (ValueError, TypeError) as error:
        raise DatasetError(
            f"description-{name}_data.csv: {error} in {dict(list(row.items())[:3])}"
        ) from error


def _value(cell: str, kind: Any) -> Any:
    if kind is int:
        return int(cell)
    if kind is bool:
        return bool(int(cell))
    if kind is float:
        return float(cell) if cell else math.nan
    if kind == tuple[str, ...]:
        return tuple(cell.split("|")) if cell else ()
    return json.loads(cell) if kind == EventRecord.__dataclass_fields__["data"].type else cell


def _responses(rows: Iterator[dict[str, str]]) -> Iterator[ResponseRecord]:
    together: dict[str, list[dict[str, str]]] = {}
    for row in rows:
        together.setdefault(row["response"], []).append(row)
    for code, lines in together.items():
        first, items = lines[0], [line for line in lines if line["item"]]
        try:
            yield ResponseRecord(
                id=code,
                questionnaire=first["questionnaire"],
                version=int(first["version"]),
                participant=first["participant"],
                session=first["session"],
                finished=bool(int(first["finished"])),
                values={line["item"]: json.loads(line["value"]) for line in items if line["value"]},
                missing={line["item"]: line["missing"] for line in items if line["missing"]},
                seconds={line["item"]: float(line["seconds"]) for line in items if line["seconds"]},
            )
        except ValueError as error:
            raise DatasetError(f"description-answers_data.csv: response {code}: {error}") from error


def _decoded(path: Path, kind: Any) -> Any:
    try:
        return msgspec.json.decode(path.read_bytes(), type=kind)
    except (OSError, msgspec.DecodeError, UnicodeDecodeError) as error:
        raise DatasetError(f"{path.name} cannot be read: {error}") from error


def _plan(path: Path) -> floorplan.FloorPlan:
    try:
        return floorplan.decode(path.read_bytes())
    except (OSError, floorplan.FloorPlanError) as error:
        raise DatasetError(f"{path.name} cannot be read: {error}") from error
