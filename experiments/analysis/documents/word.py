"""Tables and sentences as documents of Word (Office Open XML, ECMA-376), written by hand: they are
pages of text, and a library for the format would bring a parser of XML in C
(docs/explanation/decisions/). The same content gives the same bytes: no file has a date.
"""

import io
import zipfile
from collections.abc import Iterable, Sequence
from xml.sax.saxutils import escape

from experiments.analysis.documents.typesetting import Run, head_runs, parts_of
from experiments.analysis.tables.table import Table

PAGE = (16838, 11906)  # twentieths of a point: A4, landscape
MARGIN = 1134  # 2 cm
SIZE, SMALL = 18, 16  # half points
FONT = "Times New Roman"
POSITIONS = {"sub": "subscript", "super": "superscript"}
# XML has no way to write these.
_UNWRITABLE = dict.fromkeys((*range(9), 11, 12, *range(14, 32), 65534, 65535))
_HEAD = '<?xml version="1.0" encoding="UTF-8" standalone="yes"?>\n'
_PACKAGE = "http://schemas.openxmlformats.org/package/2006"
_OFFICE = "http://schemas.openxmlformats.org/officeDocument/2006"
_MIME = "application/vnd.openxmlformats-"
_MEMBERS = {
    "[Content_Types].xml": f'{_HEAD}<Types xmlns="{_PACKAGE}/content-types">'
    f'<Default Extension="rels" ContentType="{_MIME}package.relationships+xml"/>'
    '<Override PartName="/word/document.xml" '
    f'ContentType="{_MIME}officedocument.wordprocessingml.document.main+xml"/></Types>',
    "_rels/.rels": f'{_HEAD}<Relationships xmlns="{_PACKAGE}/relationships">'
    f'<Relationship Id="rId1" Type="{_OFFICE}/relationships/officeDocument" '
    'Target="word/document.xml"/></Relationships>',
}
_W = "http://schemas.openxmlformats.org/wordprocessingml/2006/main"


def table_document(table: Table) -> bytes:
    """Return a table as a document, in parts if it is wide, with the lines of the APA's tables."""
    return _document("".join(_part(part) for part in parts_of(table)))


def text_document(paragraphs: Iterable[Sequence[Run]]) -> bytes:
    return _document("".join(_paragraph(runs) for runs in paragraphs))


def _tag(name: str, *inner: str, **attributes: object) -> str:
    about = "".join(f' w:{key}="{value}"' for key, value in attributes.items())
    return f"<w:{name}{about}>{''.join(inner)}</w:{name}>"


def _line(side: str, size: int) -> str:
    return _tag(side, val="single", sz=size, space=0, color="000000")


def _part(table: Table) -> str:
    notes = (
        _paragraph((Run("Note. ", italic=True), Run(note)) if not place else (Run(note),), SMALL)
        for place, note in enumerate(table.notes)
    )
    title = _paragraph((Run(table.title, italic=True),), keep=True)
    return "".join((title, _table(table), *notes, _paragraph(())))


def _table(table: Table) -> str:
    numeric = table.are_numeric
    width = (PAGE[0] - 2 * MARGIN) // max(1, len(table.head))
    borders = _tag("tblBorders", _line("top", 8), _line("bottom", 8))
    return _tag(
        "tbl",
        _tag("tblPr", _tag("tblW", w=0, type="auto"), borders),
        _tag("tblGrid", *(_tag("gridCol", w=width) for _name in table.head)),
        _row([head_runs(name) for name in table.head], numeric, is_head=True),
        *(_row([(Run(cell.text),) for cell in row], numeric) for row in table.rows),
    )


def _row(cells: Sequence[Sequence[Run]], numeric: Sequence[bool], *, is_head: bool = False) -> str:
    """Return a row; a head is repeated on each page, and no row is divided by a page."""
    border = _tag("tcBorders", _line("bottom", 4)) if is_head else ""
    repeated = _tag("tblHeader") if is_head else ""
    written = (
        _tag("tc", _tag("tcPr", border), _paragraph(runs, SMALL, right=right))
        for runs, right in zip(cells, numeric, strict=True)
    )
    return _tag("tr", _tag("trPr", _tag("cantSplit"), repeated), *written)


def _paragraph(
    runs: Iterable[Run], size: int = SIZE, *, right: bool = False, keep: bool = False
) -> str:
    """Return a paragraph; one that is kept is on the page of the next one."""
    kept, aligned = _tag("keepNext") if keep else "", _tag("jc", val="right") if right else ""
    about = _tag("pPr", kept, _tag("spacing", before=0, after=40), aligned)
    return _tag("p", about, *(_run(run, size) for run in runs))


def _run(run: Run, size: int) -> str:
    font, italic = _tag("rFonts", ascii=FONT, hAnsi=FONT, cs=FONT), _tag("i") if run.italic else ""
    position = _tag("vertAlign", val=POSITIONS[run.position]) if run.position else ""
    about = _tag("rPr", font, italic, _tag("sz", val=size), position)
    text = escape(run.text.translate(_UNWRITABLE))
    return _tag("r", about, f'<w:t xml:space="preserve">{text}</w:t>')


def _document(body: str) -> bytes:
    margins = dict.fromkeys(("top", "right", "bottom", "left"), MARGIN)
    size = _tag("pgSz", w=PAGE[0], h=PAGE[1], orient="landscape")
    page = _tag("sectPr", size, _tag("pgMar", **margins, header=567, footer=567, gutter=0))
    document = f'{_HEAD}<w:document xmlns:w="{_W}">{_tag("body", body, page)}</w:document>'
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, text in {**_MEMBERS, "word/document.xml": document}.items():
            # always on the same day
            about = zipfile.ZipInfo(name)
            about.external_attr = 0o644 << 16
            archive.writestr(about, text.encode(), zipfile.ZIP_DEFLATED)
    return buffer.getvalue()
