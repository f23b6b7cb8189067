"""A column of a dataset's files, declared once: on the field of the record that fills it, or beside
the formula that computes it. Header, code book, reading, writing and labels are derived from it.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, dataclass, field, fields, is_dataclass, replace
from typing import Any, get_args, get_type_hints

import msgspec
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Columns = npt.NDArray[np.void]  # numbers in named columns: `columns["x"]` is (n,)
REQUIRED = MISSING  # the default of a field that has none
NO_YES = {"0": "no", "1": "yes"}
TIMES = (
    "Times are in seconds. Those of a session count from the moment at which the server granted the"
    " robot to the participant, by the clock that their column names; times before it are below 0."
    " An empty cell or nan is a missing value."
)


@dataclass(frozen=True)
class Column:
    """A column: its name in the file, the unit of its values ("" for a count, a word or a share),
    and its meaning.

    A `late` column may be missing, because earlier releases wrote datasets without it; `was` is the
    name that it had there. `least` and `greatest` bound its numbers. `levels` has the meaning of
    each text that a cell may have, and is empty where the texts are not listed. A cell with several
    texts is split at `divider`.
    """

    name: str
    unit: str
    meaning: str
    late: bool = False
    least: float | None = None
    greatest: float | None = None
    levels: Mapping[str, str] = field(default_factory=dict)
    divider: str = ""
    was: str = ""
    is_text: bool = False


Tables = Mapping[str, tuple[Column, ...]]  # the columns of tables, by name


def flag(name: str, meaning: str, *, late: bool = False) -> Column:
    return Column(name, "", meaning, late, levels=NO_YES)


def share(name: str, meaning: str, *, late: bool = False) -> Column:
    """Return a column of numbers from 0 to 1."""
    return Column(name, "", meaning, late, 0.0, 1.0)


def amount_of(name: str, unit: str, meaning: str, *, late: bool = False) -> Column:
    """Return a column of counts, times, distances and the like, which are never below 0."""
    return Column(name, unit, meaning, late, 0.0)


def described(meaning: str, unit: str = "", **more: Any) -> Column:
    """Return the column of the msgspec field that it annotates, whose name is the field's."""
    return Column("", unit, meaning, **more)


def amount(meaning: str, unit: str = "", **more: Any) -> Column:
    """Return `described` for a count, a time, a distance or the like, which are never below 0."""
    return described(meaning, unit, least=0.0, **more)


def column(default: Any, meaning: str, unit: str = "", **more: Any) -> Any:
    """Return the field of a dataclass that is a column of the field's name."""
    metadata = {"column": described(meaning, unit, **more)}
    if default == {}:
        return field(default_factory=dict, metadata=metadata)
    return field(default=default, metadata=metadata)


def word(meaning: str, levels: Mapping[str, str] | None = None, **more: Any) -> Any:
    """Return `column` for a text that may be empty."""
    return column("", meaning, levels=levels or {}, **more)


def measure(meaning: str, unit: str = "", **more: Any) -> Any:
    """Return `column` for a number that may be missing."""
    return column(math.nan, meaning, unit, **more)


def declared(kind: type) -> tuple[Column, ...]:
    """Return the columns that the fields of a record declare, in the order of the fields."""
    return tuple(column for _, column in column_paths(kind))


def column_paths(kind: type, prefix: str = "") -> Iterator[tuple[str, Column]]:
    """Yield each column that the fields of a record declare with the attribute of its value, which
    may be one of a nested structure: `pose.x`.
    """
    own = fields(kind) if is_dataclass(kind) else ()
    known = {one.name: one.metadata["column"] for one in own if "column" in one.metadata}
    for name, hint in _hints(kind):
        notes = (one for one in getattr(hint, "__metadata__", ()) if isinstance(one, Column))
        found = known.get(name) or next(notes, None)
        if found is not None:
            plain = hint.__origin__ if hasattr(hint, "__metadata__") else hint
            kinds = {plain, *get_args(plain)}
            levels = NO_YES if bool in kinds else found.levels
            is_text = not kinds & {bool, int, float}
            yield prefix + name, replace(found, name=name, levels=levels, is_text=is_text)
        elif isinstance(hint, type) and issubclass(hint, msgspec.Struct):
            yield from column_paths(hint, f"{prefix}{name}.")


def _hints(kind: type) -> Iterator[tuple[str, Any]]:
    """Yield the annotations of fields, then those of properties, which are written and not read."""
    yield from get_type_hints(kind, include_extras=True).items()
    for name, member in vars(kind).items():
        if isinstance(member, property):
            yield name, get_type_hints(member.fget, include_extras=True)["return"]


def columns_of(layout: tuple[Column, ...], **given: npt.ArrayLike) -> Columns:
    """Return columns of one length, (n,); those that are not given are NaN."""
    length = len(np.atleast_1d(next(iter(given.values())))) if given else 0
    found = np.empty(length, dtype=[(column.name, np.float64) for column in layout])
    matrix_of(found).fill(np.nan)
    for name, numbers in given.items():
        found[name] = numbers
    return found


def matrix_of(columns: Columns) -> Floats:
    """Return a view of all columns as one array, (n, columns), in their order."""
    names = columns.dtype.names or ()
    return columns.view(np.float64).reshape(len(columns), len(names))
