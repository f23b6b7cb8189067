"""Every text of the pages is in the Spanish catalogue, and translated."""

import ast
import csv
import re
from collections.abc import Iterator
from pathlib import Path

from django.conf import settings
from django.utils.translation.template import templatize

from tests.support.media.sources import PACKAGES, python_files, text_of
from tests.unit.site.test_templates import po_entries

ROOT = settings.BASE_DIR
MARKS = {"_", "gettext", "gettext_lazy", "gettext_noop", "ngettext", "ngettext_lazy"}
COLUMNS = ("words", "label", "item", "hint")  # of tables (surveys.document_forms.guide.word_table)
IN_CONTEXT = {"pgettext", "pgettext_lazy"}  # the context comes before the text
CALLED = re.compile(r"\b(?:_|[np]?gettext\w*)\(")
MARKED = re.compile(r"\b(_|gettext|ngettext|pgettext)\(")


def texts_of(code: str) -> Iterator[tuple[str | None, str]]:
    """Yield context and text of what a module marks for translation; of plurals, the singular."""
    for node in ast.walk(ast.parse(code)):
        if not isinstance(node, ast.Call):
            continue
        name = getattr(node.func, "id", "")
        at = 1 if name in IN_CONTEXT else 0
        if name in MARKS | IN_CONTEXT and isinstance(node.args[at], ast.Constant):
            yield (node.args[0].value if at else None), node.args[at].value


def texts_of_template(source: str) -> Iterator[tuple[str | None, str]]:
    """Yield what a template marks, as Django prepares it for xgettext."""
    prepared = templatize(source)
    for found in MARKED.finditer(prepared):
        depth, end = 1, found.end()
        while depth:
            quoted = re.compile(r"u?(\"(?:[^\"\\]|\\.)*\"|'(?:[^'\\]|\\.)*')").match(prepared, end)
            end = quoted.end() if quoted else end + 1
            depth += {"(": 1, ")": -1}.get(prepared[end - 1], 0) if not quoted else 0
        yield from texts_of(prepared[found.start() : end])


def texts_of_table(path: Path) -> Iterator[str]:
    with path.open(encoding="utf-8", newline="") as table:
        for row in csv.DictReader(table):
            yield from (row[name] for name in COLUMNS if row.get(name))


def marked() -> Iterator[tuple[Path, tuple[str | None, str]]]:
    for app in PACKAGES:
        for path in python_files(app):
            if CALLED.search(text_of(path)):
                yield from ((path, text) for text in texts_of(text_of(path)))
        for path in (ROOT / app).rglob("*.csv"):
            yield from ((path, (None, text)) for text in texts_of_table(path))
    for path in (ROOT / "templates").rglob("*"):
        if path.suffix in {".html", ".txt"}:
            yield from ((path, text) for text in texts_of_template(path.read_text()))


def test_every_text_is_in_spanish_too():
    spanish = {
        (entry.get("msgctxt"), entry["msgid"]): entry.get("msgstr") or entry.get("msgstr[0]")
        for entry in po_entries()
        if "fuzzy" not in entry["flags"]
    }
    texts = list(marked())
    assert len(texts) > 1500
    missing = {f"{path.relative_to(ROOT)}: {text}" for path, text in texts if not spanish.get(text)}
    assert not missing, "see CONTRIBUTING.md for how texts come into the catalogue"
