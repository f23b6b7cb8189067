"""Tables and sentences as documents of Word (Office Open XML, ECMA-376), written by hand: what is
needed of the format is a page of text, and the library for it would bring a parser of XML in C
(docs/explanation/decisions/). The same content gives the same bytes: no file has a date.
"""

import io
import zipfile
from collections.abc import Iterable, Iterator, Sequence
from xml.sax.saxutils import escape

from experiments.analysis.documents.parts import parts_of
from experiments.analysis.documents.runs import Run, head_runs
from experiments.analysis.tables.table import Table, TableCell

SAME_DAY = (1980, 1, 1, 0, 0, 0)
PAGE = (16838, 11906)  # twentieths of a point: A4, landscape
MARGIN = 1134  # 2 cm
SIZE, SMALL = 18, 16  # half points
_HEAD = '<?xml version="1.0" encoding="UTF-8" standalone="yes"?>\n'
_W = "http://schemas.openxmlformats.org/wordprocessingml/2006/main"
_TYPES = (
    f'{_HEAD}<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
    '<Default Extension="rels" '
    'ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
    '<Override PartName="/word/document.xml" ContentType="application/'
    'vnd.openxmlformats-officedocument.wordprocessingml.document.main+xml"/></Types>'
)
_RELATIONS = (
    f'{_HEAD}<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
    '<Relationship Id="rId1" Type="http://schemas.openxmlformats.org/officeDocument/2006/'
    'relationships/officeDocument" Target="word/document.xml"/></Relationships>'
)
_POSITIONS = {"sub": "subscript", "super": "superscript"}
# XML has no way to write these.
_UNWRITABLE = dict.fromkeys((*range(9), 11, 12, *range(14, 32), 65534, 65535))


def table_document(table: Table) -> bytes:
    """Return a table as a document, in parts where it is wide: lines above, below the head and
    below the table, as the APA prints them.
    """
    return _document("".join(_part(part) for part in parts_of(table)))


def text_document(paragraphs: Iterable[Sequence[Run]]) -> bytes:
    """Return paragraphs as a document."""
    return _document("".join(_paragraph(runs) for runs in paragraphs))


def _part(table: Table) -> str:
    notes = "".join(
        _paragraph((Run("Note. ", italic=True), Run(note)) if not place else (Run(note),), SMALL)
        for place, note in enumerate(table.notes)
    )
    return f"{_paragraph((Run(table.title, italic=True),), keep=True)}{_table(table)}{notes}" + (
        _paragraph(())
    )


def _table(table: Table) -> str:
    numeric = [_is_numeric(row[place] for row in table.rows) for place in range(len(table.head))]
    head = _row([head_runs(name) for name in table.head], numeric, is_head=True)
    rows = "".join(_row([(Run(cell.text),) for cell in row], numeric) for row in table.rows)
    rule = '<w:{0} w:val="single" w:sz="8" w:space="0" w:color="000000"/>'
    borders = f"<w:tblBorders>{rule.format('top')}{rule.format('bottom')}</w:tblBorders>"
    width = (PAGE[0] - 2 * MARGIN) // max(1, len(table.head))
    grid = f'<w:gridCol w:w="{width}"/>' * len(table.head)
    return (
        f'<w:tbl><w:tblPr><w:tblW w:w="0" w:type="auto"/>{borders}</w:tblPr>'
        f"<w:tblGrid>{grid}</w:tblGrid>{head}{rows}</w:tbl>"
    )


def _is_numeric(cells: Iterable[TableCell]) -> bool:
    return any(cell.value is not None for cell in cells)


def _row(cells: Sequence[Sequence[Run]], numeric: Sequence[bool], *, is_head: bool = False) -> str:
    """Return a row; a head is repeated on each page, and no row is divided by a page."""
    repeated = "<w:tblHeader/>" if is_head else ""
    line = (
        '<w:tcBorders><w:bottom w:val="single" w:sz="4" w:space="0" w:color="000000"/>'
        "</w:tcBorders>"
        if is_head
        else ""
    )
    inside = "".join(
        f"<w:tc><w:tcPr>{line}</w:tcPr>{_paragraph(runs, SMALL, right=right)}</w:tc>"
        for runs, right in zip(cells, numeric, strict=True)
    )
    return f"<w:tr><w:trPr><w:cantSplit/>{repeated}</w:trPr>{inside}</w:tr>"


def _paragraph(
    runs: Iterable[Run], size: int = SIZE, *, right: bool = False, keep: bool = False
) -> str:
    """Return a paragraph; one that is kept stands on the page of what follows."""
    about = "<w:keepNext/>" if keep else ""
    about += '<w:spacing w:before="0" w:after="40"/>'
    about += '<w:jc w:val="right"/>' if right else ""
    return f"<w:p><w:pPr>{about}</w:pPr>{''.join(_run(run, size) for run in runs)}</w:p>"


def _run(run: Run, size: int) -> str:
    italic = "<w:i/>" if run.italic else ""
    position = f'<w:vertAlign w:val="{_POSITIONS[run.position]}"/>' if run.position else ""
    about = (
        '<w:rFonts w:ascii="Times New Roman" w:hAnsi="Times New Roman" w:cs="Times New Roman"/>'
        f'{italic}<w:sz w:val="{size}"/>{position}'
    )
    text = escape(run.text.translate(_UNWRITABLE))
    return f'<w:r><w:rPr>{about}</w:rPr><w:t xml:space="preserve">{text}</w:t></w:r>'


def _document(body: str) -> bytes:
    page = (
        f'<w:sectPr><w:pgSz w:w="{PAGE[0]}" w:h="{PAGE[1]}" w:orient="landscape"/>'
        f'<w:pgMar w:top="{MARGIN}" w:right="{MARGIN}" w:bottom="{MARGIN}" w:left="{MARGIN}" '
        'w:header="567" w:footer="567" w:gutter="0"/></w:sectPr>'
    )
    document = f'{_HEAD}<w:document xmlns:w="{_W}"><w:body>{body}{page}</w:body></w:document>'
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in _members(document):
            about = zipfile.ZipInfo(name, SAME_DAY)
            about.compress_type = zipfile.ZIP_DEFLATED
            about.external_attr = 0o644 << 16
            archive.writestr(about, text.encode())
    return buffer.getvalue()


def _members(document: str) -> Iterator[tuple[str, str]]:
    yield "[Content_Types].xml", _TYPES
    yield "_rels/.rels", _RELATIONS
    yield "word/document.xml", document
