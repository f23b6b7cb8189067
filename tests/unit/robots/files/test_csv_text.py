"""CSV that programs read back without a difference, and in which a spreadsheet finds no formula,
whatever it takes for a separator.
"""

import csv
import io
import re

import pytest
from hypothesis import given, strategies as st

from robots.files.csv_text import csv_text, unguarded

CELLS = st.text(alphabet="aé=+-@＝\t\r\n;,'\"| 1.", max_size=12)
ROWS = st.lists(st.lists(CELLS, min_size=1, max_size=4), max_size=4)
FORMULA = re.compile(r"\s*[=+\-@＝＋－＠]")
NUMBER = re.compile(r"[+-]?[0-9]+(\.[0-9]+)?(e[+-]?[0-9]+)?")


def spreadsheet_cells(text: str, separator: str) -> list[str]:
    """Return the cells of a spreadsheet with this list separator. Like Excel, Python's reader takes
    a quote in the middle of a cell for a character; every CR and LF outside quotes ends a row.
    """
    lines = re.split(r"(?<=[\r\n])", text)
    return [cell for row in csv.reader(lines, delimiter=separator) for cell in row]


@given(rows=ROWS)
def test_rows_are_read_back_as_they_were_written(rows):
    read = list(csv.reader(io.StringIO(csv_text(rows), newline=""), strict=True))
    assert [[unguarded(cell) for cell in row] for row in read] == rows


@given(rows=ROWS)
@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_no_spreadsheet_finds_a_formula_in_a_cell(separator, rows):
    for cell in spreadsheet_cells(csv_text(rows), separator):
        assert not FORMULA.match(cell) or NUMBER.fullmatch(cell)


@pytest.mark.parametrize(
    ("cell", "written"),
    [
        ("fine\r=HYPERLINK(A1)", '"fine\r\'=HYPERLINK(A1)"'),
        ("x;=cmd|' /C calc'!A0", "\"x;'=cmd|' /C calc'!A0\""),
        ('x\t"=1+1"', '"x\t""\'=1+1"""'),
        ("=1+1", "'=1+1"),
        ("'quoted", "''quoted"),
        ("-2.5", "-2.5"),
        ("plain words", "plain words"),
        ("a;b", '"a;b"'),
        (None, ""),
        (0.1, "0.1"),
        (-3, "-3"),
        (True, "True"),
    ],
)
def test_cells_are_quoted_and_guarded_where_they_need_it(cell, written):
    assert csv_text([["id", cell, "end"]]) == f"id,{written},end\n"


def test_a_number_that_begins_a_line_does_not_make_a_formula_of_the_line():
    assert csv_text([["-1", "2+cmd|' /C calc'!A0"]]) == "'-1,2+cmd|' /C calc'!A0\n"


def test_a_row_of_one_empty_cell_is_no_blank_line():
    assert csv_text([[""]]) == '""\n'
