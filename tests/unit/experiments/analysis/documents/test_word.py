"""Tables as documents of Word: well-formed, whole, and the same bytes every time."""

import io
import zipfile
from xml.etree import ElementTree as ET

from experiments.analysis.documents.typesetting import Run
from experiments.analysis.documents.word import table_document, text_document
from experiments.analysis.tables.table import Table, number, words

W = "{http://schemas.openxmlformats.org/wordprocessingml/2006/main}"
NASTY = 'a < b & "c" \x00 – ñ ]]>'
ROWS = ((words(NASTY), number(1.5)), (words("=1"), number(None)))
TABLE = Table("t", NASTY, ("", "slow: mean"), ROWS, ("N.",))


def document(content: bytes) -> ET.Element:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        assert archive.testzip() is None
        for name in archive.namelist():
            ET.fromstring(archive.read(name))
        return ET.fromstring(archive.read("word/document.xml"))


def text(part: ET.Element) -> str:
    return "".join(one.text or "" for one in part.iter(f"{W}t"))


def test_a_document_has_every_cell_with_any_text():
    rows = list(document(table_document(TABLE)).iter(f"{W}tr"))
    cells = [[text(cell) for cell in row.iter(f"{W}tc")] for row in rows]
    assert cells == [["", "slow: M"], [NASTY.replace("\x00", ""), "1.50"], ["=1", "–"]]


def test_a_head_is_repeated_on_each_page_and_symbols_are_in_italics():
    head, *rows = document(table_document(TABLE)).iter(f"{W}tr")
    assert head.find(f"{W}trPr/{W}tblHeader") is not None
    assert all(row.find(f"{W}trPr/{W}tblHeader") is None for row in rows)
    italic = [run for run in head.iter(f"{W}r") if run.find(f"{W}rPr/{W}i") is not None]
    assert [text(run) for run in italic] == ["M"]


def test_a_wide_table_is_split_into_several():
    wide = Table("w", "W.", tuple("abcdefghijklmn"), (tuple(number(1.0) for _ in range(14)),))
    assert len(list(document(table_document(wide)).iter(f"{W}tbl"))) == 2


def test_the_same_content_gives_the_same_bytes():
    assert table_document(TABLE) == table_document(TABLE)
    with zipfile.ZipFile(io.BytesIO(table_document(TABLE))) as archive:
        assert {one.date_time for one in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}


def test_a_subscript_is_one():
    (run,) = document(text_document([(Run("z", italic=True, position="sub"),)])).iter(f"{W}r")
    assert run.find(f"{W}rPr/{W}vertAlign").get(f"{W}val") == "subscript"
