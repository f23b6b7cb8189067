"""Tables with labels of variables and values, for SPSS (.sav) and Stata (.dta); R reads both with
haven.

Texts of a list become numbers from 1, in the order of the code book, with their meanings as labels.
The reason for which there is no answer is a user-missing value of the answer's variable, and a
variable of its own as in the CSV files.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from django.utils.translation import gettext_lazy as _

from experiments.dataset.columns import Column
from experiments.dataset.files import as_cell, data_tables, keyword_values
from experiments.dataset.levels import MISSING
from experiments.export.format import ExportFormat, File
from experiments.export.formats.conditions import condition_columns, condition_rows
from experiments.export.formats.dataset import METRIC_TABLE, metric_rows

LEFT_OUT = frozenset({"events", "answers"})  # their cells are JSON
# User-missing values, of SPSS and of Stata; no answer on a scale is so low.
REASONS = {word: -9991.0 - number for number, word in enumerate(MISSING)}
LETTERS = {code: chr(ord("a") + number) for number, code in enumerate(REASONS.values())}
NAME_BYTES = {"sav": 64, "dta": 32}
LABEL_BYTES = {"sav": 255, "dta": 80}
VALUE_LABEL_BYTES = 120  # of SPSS, the shorter ones
NO_NAMES = frozenset({"all", "and", "by", "eq", "ge", "gt", "in", "if", "le", "lt", "ne", "not"})
NO_NAMES |= {"or", "to", "using", "with"}  # words of either language
NAN = float("nan")
NUMBER = re.compile(r"-?[0-9]+")
# Where both formats have the time of writing, which would make each export another one.
SAV_DATE, SAV_NEVER = slice(92, 109), b"01 Jan 8000:00:00"
DTA_DATE = re.compile(rb"<timestamp>.*?</timestamp>", re.DOTALL)
DTA_NEVER = b"<timestamp>\x1101 Jan 1980 00:00</timestamp>"


class LabelledFormat(ExportFormat):
    label = _("with files for SPSS and Stata")
    help = "with files for SPSS and Stata, with labels"

    def at_last(self) -> Iterator[File]:
        for name, layout, rows in self._tables():
            table = labelled(layout, list(rows))
            for ending in NAME_BYTES:
                yield f"labelled/{name}.{ending}", [written(table, ending)]

    def _tables(self) -> Iterator[tuple[str, Sequence[Column], Iterable[Sequence[Any]]]]:
        dataset = self.source.dataset
        questionnaires = keyword_values(one.slug for one in dataset.questionnaires)
        for one in data_tables(dataset):
            if one.name not in LEFT_OUT:
                own = questionnaires.get(one.name)
                yield f"questionnaire-{own}" if own else one.name, one.layout, one.rows
        yield "metrics", METRIC_TABLE, metric_rows(self.source)
        yield "conditions", condition_columns(dataset), condition_rows(self.source)


@dataclass(frozen=True)
class Variable:
    """A column as numbers or texts; `reasons` are the codes of user-missing values among them."""

    column: Column
    values: list[Any]
    labels: dict[float, str] = field(default_factory=dict)
    reasons: dict[float, str] = field(default_factory=dict)

    @property
    def measure(self) -> str:
        """The level of measurement, as SPSS calls it."""
        is_number = all(isinstance(one, float) for one in self.values)
        if not is_number or (self.labels and self.column.least is None):
            return "nominal"
        return "ordinal" if self.labels else "scale"


def labelled(layout: Sequence[Column], rows: Sequence[Sequence[Any]]) -> list[Variable]:
    values = {column.name: [row[at] for row in rows] for at, column in enumerate(layout)}
    return [_variable(column, values) for column in layout]


def _variable(column: Column, table: Mapping[str, list[Any]]) -> Variable:
    plain = (as_cell(one) if isinstance(one, tuple | dict) else one for one in table[column.name])
    values = [None if one == "" else one for one in plain]
    known = [one for one in values if one is not None]
    if column.levels and not column.divider and not all(map(NUMBER.fullmatch, column.levels)):
        return _coded(column, [None if one is None else str(one) for one in values])
    is_number = all(isinstance(one, int | float) for one in known)
    is_text = not known and not (column.unit or column.levels or column.least is not None)
    if column.divider or is_text or not is_number:
        return Variable(column, ["" if one is None else str(as_cell(one)) for one in values])
    numbers = [NAN if one is None else float(one) for one in values]
    labels = {float(word): meaning for word, meaning in column.levels.items() if meaning}
    why = table.get(f"{column.name}_missing", [""] * len(numbers))
    reasons = {REASONS[word]: MISSING[word] for word in REASONS if word in set(why)}
    numbers = [REASONS.get(one, number) for number, one in zip(numbers, why, strict=True)]
    return Variable(column, numbers, labels, reasons)


def _coded(column: Column, values: Sequence[str | None]) -> Variable:
    """Return words as numbers; those that the code book does not list come last."""
    others = sorted({one for one in values if one is not None} - set(column.levels))
    codes = {word: float(code) for code, word in enumerate((*column.levels, *others), start=1)}
    labels = {code: column.levels.get(word) or word for word, code in codes.items()}
    return Variable(column, [NAN if one is None else codes[one] for one in values], labels)


def written(table: Sequence[Variable], ending: str) -> bytes:
    """Return variables as a file of SPSS (`sav`) or Stata (`dta`)."""
    # Packages for analysis, which a robot's computer lacks.
    import pandas as pd  # noqa: PLC0415
    import pyreadstat  # noqa: PLC0415

    names = variable_names([one.column.name for one in table], NAME_BYTES[ending])
    named = dict(zip(names, table, strict=True))
    frame = pd.DataFrame({name: _stored(one.values, ending) for name, one in named.items()})
    options: dict[str, Any] = {
        "column_labels": [_label(one.column, LABEL_BYTES[ending]) for one in table],
        "variable_value_labels": {
            name: {
                LETTERS.get(code, code) if ending == "dta" else code: _cut(text, VALUE_LABEL_BYTES)
                for code, text in own.items()
            }
            for name, one in named.items()
            if (own := one.labels | one.reasons)
        },
    }
    reasons = {name: _stored(one.reasons, ending) for name, one in named.items() if one.reasons}
    with TemporaryDirectory() as folder:
        path = Path(folder, f"table.{ending}")
        if ending == "dta":
            pyreadstat.write_dta(frame, path, **options, missing_user_values=reasons)
            return DTA_DATE.sub(DTA_NEVER, path.read_bytes())
        options["missing_ranges"] = {
            name: [{"lo": min(own), "hi": max(own)}] for name, own in reasons.items()
        }
        options["variable_measure"] = {name: one.measure for name, one in named.items()}
        pyreadstat.write_sav(frame, path, **options)
        content = bytearray(path.read_bytes())
    content[SAV_DATE] = SAV_NEVER
    return bytes(content)


def _stored(values: Iterable[Any], ending: str) -> list[Any]:
    """Return values or codes; reasons are letters in Stata."""
    return [LETTERS.get(one, one) for one in values] if ending == "dta" else [*values]


def _label(column: Column, most: int) -> str:
    return _cut(f"{column.meaning} ({column.unit})" if column.unit else column.meaning, most)


def _cut(text: str, most: int) -> str:
    if len(text.encode()) <= most:
        return text
    return text.encode()[: most - 3].decode(errors="ignore") + "…"


def variable_names(names: Sequence[str], most: int) -> list[str]:
    """Return names of letters, digits and underscores that are unique without regard to case."""
    found: list[str] = []
    for name in names:
        plain = re.sub(r"[^A-Za-z0-9_]", "_", name)
        if not plain[:1].isalpha() or plain.lower() in NO_NAMES:
            plain = f"v_{plain}"
        taken = {one.lower() for one in found}
        number, own = 1, plain[:most]
        while own.lower() in taken:
            number += 1
            own = f"{plain[: most - len(str(number)) - 1]}_{number}"
        found.append(own)
    return found
