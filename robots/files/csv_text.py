"""CSV for programs and spreadsheets: every table that people download is written here.

A spreadsheet takes a cell that begins with = + - @ for a formula. Which cells it finds depends on
its list separator: where that is ; or a tab, the quotes around a cell in the middle of a line count
as characters, so that a text can be split within them, and a line break in it begins a row. An
apostrophe therefore precedes a formula at the beginning of a cell and after each ; tab CR and LF.
"""

import re
from collections.abc import Iterable
from typing import Any

_STARTS = r"(^ *|[;\t\r\n][ \"]*)"
_FORMULA = re.compile(_STARTS + "(?=['=+\\-@＝＋－＠])")
_GUARD = re.compile(_STARTS + "'(?=['=+\\-@＝＋－＠])")
_NUMBER = re.compile(r"[+-]?[0-9]+(\.[0-9]+)?(e[+-]?[0-9]+)?", re.ASCII)
_QUOTED = re.compile(r'[",;\t\r\n]|^ | $')


def csv_text(rows: Iterable[Iterable[Any]]) -> str:
    """Return rows as CSV (RFC 4180, lines end with LF); None is an empty cell."""
    return "".join(f"{_line(row)}\n" for row in rows)


def _line(row: Iterable[Any]) -> str:
    # A spreadsheet that does not split at commas takes the line for the rest of its first cell, so
    # that a text there is guarded even when it is a number.
    cells = [_cell(value, is_first=place == 0) for place, value in enumerate(row)]
    return ",".join(cells) or '""'


def unguarded(cell: str) -> str:
    """Return the text of which `csv_text` wrote this cell."""
    return _GUARD.sub(r"\1", cell)


def _cell(value: Any, *, is_first: bool) -> str:
    if value is None or isinstance(value, int | float):
        return "" if value is None else str(value)
    text = str(value)
    if text.isalnum():
        return text
    if is_first or not _NUMBER.fullmatch(text):
        text = _FORMULA.sub(r"\1'", text)
    return '"' + text.replace('"', '""') + '"' if _QUOTED.search(text) else text
