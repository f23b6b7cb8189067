"""A dataset as files: names and texts, made one after the other, so that they can be written into a
folder or sent as they are made.

Numbers are written with as many digits as they have, so that reading gives the same ones.
"""

import csv
import io
import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice
from types import MappingProxyType
from typing import Any

import msgspec
import numpy as np

from experiments.analysis.dataset import columns
from experiments.analysis.dataset.columns import Column
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
from experiments.definition.schema import to_json as study_json
from robots.api import floorplan
from surveys.definition import Definition, cells_of, columns_of, to_json
from surveys.documents import spoken
from surveys.item import Question
from surveys.scoring import scores

File = tuple[str, Iterable[str]]  # where in the folder, and its text in parts
TABLES = {
    "participants": columns.PARTICIPANTS,
    "sessions": columns.SESSIONS,
    "events": columns.EVENTS,
    "pages": columns.PAGES,
    "answers": columns.ANSWERS,
}
WIDE = ("response", "version", "participant", "session", "finished")
LINES_AT_ONCE = 500
EXACT = 1e15  # whole numbers below it are exact
_CODE = re.compile(r"^[A-Za-z0-9-]{1,64}$")
_WORD = re.compile(r"^[a-z0-9][a-z0-9_-]{0,63}$")
# A spreadsheet takes a cell that begins so for a formula.
_FORMULA = ("=", "+", "-", "@", "\t", "\r", "'")


class DatasetError(ValueError):
    """A folder that holds no dataset, or a broken one; says which file, and what
    is wrong with it.
    """


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
    yield from wide(dataset)


def about(dataset: Dataset, more: Mapping[str, tuple[Column, ...]]) -> Iterator[File]:
    """Yield what does not grow with the sessions: description, study, robots, plans and
    questionnaires.
    """
    yield (
        "dataset_description.json",
        [json.dumps(_description(dataset, more), indent=2, ensure_ascii=False) + "\n"],
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
        yield f"plans/{_named(name, _WORD)}.json", [floorplan.encode(plan).decode() + "\n"]
    for one in dataset.questionnaires:
        yield f"questionnaires/{one.slug}-{one.version}.json", [to_json(one).decode()]


# --- tables ---------------------------------------------------------------------------------------


def table(name: str, rows: Iterable[Sequence[Any]], layout: tuple[Column, ...] = ()) -> File:
    """Return a table as a file; one that is not among TABLES needs its layout."""
    return table_path(name), lines([column.name for column in layout or TABLES[name]], rows)


def lines(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> Iterator[str]:
    """Yield rows as CSV, some at a time; none of their cells is a formula."""
    yield _csv([head])
    rest = iter(rows)
    while some := list(islice(rest, LINES_AT_ONCE)):
        yield _csv([_plain(cell) for cell in row] for row in some)


def _csv(rows: Iterable[Sequence[Any]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def cells(
    record: ParticipantRecord | SessionRecord | EventRecord | PageRecord, layout: tuple[Column, ...]
) -> list[Any]:
    """Return the cells of a record in the order of its columns."""
    return [_cell(getattr(record, column.name)) for column in layout]


def answer_rows(response: ResponseRecord) -> Iterator[list[Any]]:
    """Yield a row an item of a response; a response without items keeps one row without an item."""
    own = [
        response.id,
        response.questionnaire,
        response.version,
        response.participant,
        response.session,
        _cell(response.finished),
    ]
    for item in dict.fromkeys((*response.values, *response.missing)) or [""]:
        value = response.values.get(item)
        said = "" if value is None else json.dumps(value, ensure_ascii=False)
        yield [
            *own,
            item,
            said,
            response.missing.get(item, ""),
            _cell(response.seconds.get(item, math.nan)),
        ]


def _cell(value: Any) -> Any:
    if isinstance(value, bool):
        return int(value)
    if isinstance(value, float):
        return "" if math.isnan(value) else _number(value)
    if isinstance(value, tuple):
        return "|".join(value)
    return (
        json.dumps(value, ensure_ascii=False, sort_keys=True) if isinstance(value, dict) else value
    )


def _plain(cell: Any) -> Any:
    """Words that look like a formula get an apostrophe before them; so do those that have one, to
    tell them apart.
    """
    return (
        f"'{cell}"
        if isinstance(cell, str) and cell.startswith(_FORMULA) and not _is_number(cell)
        else cell
    )


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _number(value: float) -> str:
    return (
        "nan"
        if math.isnan(value)
        else str(int(value))
        if value.is_integer() and abs(value) < EXACT
        else repr(value)
    )


# --- answers, a line a response -------------------------------------------------------------------


def wide(dataset: Dataset) -> Iterator[File]:
    """Yield, for each questionnaire, a table with a line a response: two columns a question (its
    value, for which a type may need several, and why there is none) and the scores.
    """
    for slug in sorted({one.slug for one in dataset.questionnaires}):
        versions = [one for one in dataset.questionnaires if one.slug == slug]
        given = [one for one in dataset.responses if one.questionnaire == slug]
        yield (
            f"data/questionnaire-{slug}_data.csv",
            lines(wide_head(versions), _wide_rows(versions, given)),
        )


def wide_head(versions: Sequence[Definition]) -> list[str]:
    """Return the columns of a questionnaire in all of its versions."""
    return [*WIDE, *columns_of(versions), *_scores(versions)]


def _wide_rows(
    versions: Sequence[Definition], responses: Iterable[ResponseRecord]
) -> Iterator[list[Any]]:
    known = {one.version: one for one in versions}
    layout, named = columns_of(versions), _scores(versions)
    everywhere = {question.key: question for one in versions for question in one.questions()}
    for one in responses:
        own = known.get(one.version)
        asked = {question.key: question for question in own.questions()} if own else {}
        cells = cells_of(everywhere | asked, one.values, one.missing)
        found = scores(own, one.values) if own else {}
        yield [
            *(one.id, one.version, one.participant, one.session, _cell(one.finished)),
            *(cells.get(column, "") for column in layout),
            *("" if found.get(name) is None else found[name] for name in named),
        ]


def _scores(versions: Sequence[Definition]) -> list[str]:
    return list(dict.fromkeys(name for one in versions for name in scores(one, {})))


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


# --- names ----------------------------------------------------------------------------------------


def table_path(name: str) -> str:
    """Return where one of TABLES stands."""
    return f"data/description-{name}_data.csv"


def numbers_path(name: str, session: str) -> str:
    """Return where the states or network samples of a session stand.

    Raises:
        DatasetError: a code that cannot be the name of a file.
    """
    return f"data/{name}/session-{_named(session, _CODE).replace('-', '')}_data.csv"


def _named(name: str, pattern: re.Pattern[str]) -> str:
    if not pattern.match(name):
        raise DatasetError(f"{name!r} cannot be used as a file name")
    return name


# --- the code book --------------------------------------------------------------------------------


def _description(dataset: Dataset, more: Mapping[str, tuple[Column, ...]]) -> dict[str, Any]:
    study = dataset.study
    return {
        "@context": "https://schema.org/",
        "@type": "Dataset",
        "name": study.title.get("en") or next(iter(study.title.values()), study.slug),
        "description": f"Records of the study {study.slug}, version {study.version}.",
        "schemaVersion": "Psych-DS 0.4.0",
        "variableMeasured": [
            {"@type": "PropertyValue", "name": name, "unitText": unit, "description": meaning}
            for name, unit, meaning in _variables(dataset, more)
        ],
    }


def _variables(
    dataset: Dataset, more: Mapping[str, tuple[Column, ...]]
) -> Iterator[tuple[str, str, str]]:
    for file, layout in (
        *TABLES.items(),
        ("states", columns.STATES),
        ("network", columns.NETWORK),
        *more.items(),
    ):
        for column in layout:
            yield column.name, column.unit, f"{file}: {column.meaning}"
    for slug in sorted({one.slug for one in dataset.questionnaires}):
        versions = [one for one in dataset.questionnaires if one.slug == slug]
        asked = dict(
            pair
            for one in versions
            for question in one.questions()
            for pair in _asked(one, question, dataset.language)
        )
        for name in wide_head(versions)[len(WIDE) :]:
            yield name, "", f"{slug}: {asked.get(name, 'score')}"


def _asked(definition: Definition, question: Question, language: str) -> Iterator[tuple[str, str]]:
    """Yield each column of a question, and what it says."""
    text, item = spoken(question.text, language), question.item
    if question.key in definition.reversed:
        text += " (reverse-coded: stored as answered, scores count it from the other end)"
    for name, label in zip(item.columns(question.key), item.column_labels(), strict=True):
        about = spoken(label, language)
        yield name, f"{text} – {about}" if about else text
    yield f"{question.key}_missing", f"why there is no answer to: {text}"
