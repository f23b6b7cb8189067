"""REDCap data dictionaries: a CSV file with a row for each field.

The eighteen columns are those that REDCap documents on its data dictionary page. Read against the
dictionaries in vubiostat/redcapAPI (every field type and validation) and ReproNim/reproschema-py (a
sample of the HBCD study: matrices, action tags, branching); the names of the columns in an export
over the API are understood, too, as in IUREDCap/redcap-etl.
"""

import csv
import io
import re
from collections.abc import Iterable, Iterator
from itertools import groupby
from typing import Any, ClassVar

from django.utils.translation import gettext as _

from surveys.documents import BadDefinitionError, Text
from surveys.importing.draft import Draft, Item, SurveyFormat, language_of
from surveys.importing.redcap import RedcapField, Row, choices_of
from surveys.importing.report import Note
from surveys.problems import MAX_POINTS, MIN_POINTS

# Column → its headings in a dictionary and in an export over the API.
COLUMNS = {
    "name": ("variable / field name", "field_name"),
    "form": ("form name", "form_name"),
    "header": ("section header", "section_header"),
    "type": ("field type", "field_type"),
    "label": ("field label", "field_label"),
    "choices": ("choices, calculations, or slider labels", "select_choices_or_calculations"),
    "field_note": ("field note", "field_note"),
    "validation": (
        "text validation type or show slider number",
        "text_validation_type_or_show_slider_number",
    ),
    "min": ("text validation min", "text_validation_min"),
    "max": ("text validation max", "text_validation_max"),
    "identifier": ("identifier?", "identifier"),
    "branching": ("branching logic (show field only if...)", "branching_logic"),
    "required": ("required field?", "required_field"),
    "matrix": ("matrix group name", "matrix_group_name"),
    "ranking": ("matrix ranking?", "matrix_ranking"),
    "annotation": ("field annotation", "field_annotation"),
}
MAX_CELL = 100_000  # characters
_OR = re.compile(r"\bor\b", re.IGNORECASE)
# One comparison of a branching logic: [field] = '1', [field(2)] = "1".
_COMPARISON = re.compile(
    r"""\[(?P<name>[a-z][a-z0-9_]*(?:\([^()]+\))?)\]\s*=\s*(?P<answer>'[^']*'|"[^"]*"|-?\d+)"""
)


class Redcap(SurveyFormat):
    """A data dictionary of REDCap, field by field."""

    label: ClassVar[str] = "REDCap (.csv)"

    def __init__(self, document: bytes, language: str, form: str) -> None:
        rows = list(rows_of(document))
        self.first = rows[0] if rows else None
        forms = list(dict.fromkeys(row["form"] for row in rows))
        if form and form not in forms:
            words = _("The file has no form “%(form)s”; it has %(forms)s.")
            there = {"form": form, "forms": ", ".join(forms)[:1000]}
            raise BadDefinitionError([words % there])
        self.rows = [row for row in rows if form in {"", row["form"]}]
        self.others = [one for one in forms if form not in {"", one}]
        self.form = form or (forms[0] if len(forms) == 1 else "")
        languages = [language_of(language) or "en"]
        self.into = Draft("redcap", self.label, languages, keeps_lines=True)

    @classmethod
    def is_in(cls, document: bytes) -> bool:
        head = document[:2000].lower()
        return all(
            any(name.encode() in head for name in COLUMNS[column]) for column in ("name", "form")
        )

    def convert(self) -> None:
        self.into.title = self.into.same(_title(self.form) or "REDCap")
        self.into.source = f"REDCap, {self.form}" if self.form else "REDCap"
        for form, rows in groupby(self.rows, key=lambda row: row["form"]):
            self.into.page(self.into.same(_title(form)) if form and not self.form else {})
            self._take_form(rows)
        for form in self.others:
            self.into.leave_out(form, _("It belongs to a form that you did not choose."))

    def _take_form(self, rows: Iterable[Row]) -> None:
        for matrix, run in groupby(rows, key=_matrix_of):
            if matrix is not None:
                self._grid(list(run))
            else:
                for row in run:
                    self._field(row)

    def _field(self, row: Row) -> None:
        note = self.into.note(row["name"], row["label"])
        if row is self.first:
            note.left_out(
                _("The first field identifies the record. Here, each respondent has a key instead.")
            )
            return
        with self.into.trying(note):
            field = RedcapField(self.into, note, row)
            field.refuse_hidden()
            self._section(row)
            if row["type"] == "descriptive":
                self.into.introduce(note, field.text_of(row["label"]))
                if row["branching"].strip():
                    note.changed(_("Its condition is not imported: it is shown to everybody."))
            else:
                condition = self._condition(note, row)
                self.into.ask(note, field.items(), condition)

    def _section(self, row: Row) -> None:
        """Begin a page with the section's heading."""
        if row["header"].strip():
            heading = self._heading(row)
            is_short = all(len(text) <= 120 and "\n" not in text for text in heading.values())
            self.into.page(heading if is_short else {}, {} if is_short else heading)

    def _heading(self, row: Row) -> Text:
        note = Note(row["name"])
        heading = self.into.text({self.into.languages[0]: row["header"]}, note)
        if note.remarks:
            section = _("Section: %(name)s") % {"name": row["name"]}
            self.into.note(section, row["header"]).remarks = note.remarks
        return heading

    def _grid(self, rows: list[Row]) -> None:
        notes = [self.into.note(row["name"], row["label"]) for row in rows]
        fields = [RedcapField(self.into, note, row) for note, row in zip(notes, rows, strict=True)]
        with self.into.trying(notes[0]):
            heading = self._heading(rows[0]) if rows[0]["header"].strip() else {}
            if not heading:
                notes[0].changed(
                    _("Its matrix has no heading, so the name of the matrix is shown.")
                )
            condition = self._condition(notes[0], rows[0])
            item = fields[0].grid(fields, heading)
            self.into.ask(notes[0], [item], condition)
            for note, own in zip(notes, item["rows"], strict=True):
                note.keys = [own["key"]]
            return
        for note in notes[1:]:
            note.left_out(notes[0].remarks[0])

    def _condition(self, note: Note, row: Row) -> Item | None:
        logic = row["branching"]
        return self.into.comparisons(note, logic, _OR, _COMPARISON) if logic.strip() else None


def rows_of(document: bytes) -> Iterator[Row]:
    """Yield the fields of a dictionary with all COLUMNS, in order.

    Raises:
        BadDefinitionError: it is no CSV, or lacks columns.
    """
    try:
        text = document.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = document.decode("cp1252", errors="replace")
    text = text.replace("\x00", "")
    head = re.split(r"[\r\n]", text, maxsplit=1)[0]
    delimiter = max(",;\t", key=head.count)
    csv.field_size_limit(MAX_CELL)
    try:
        table = list(csv.reader(io.StringIO(text, newline=""), delimiter=delimiter))
    except csv.Error as error:
        told = _("This is not a valid CSV file: %(problem)s.") % {"problem": error}
        raise BadDefinitionError([told]) from error
    headings = [one.strip().strip('"').lower() for one in table[0]]
    places = {
        column: headings.index(name)
        for column, names in COLUMNS.items()
        for name in reversed(names)
        if name in headings
    }
    lacking = [COLUMNS[one][0] for one in ("name", "type", "label") if one not in places]
    if lacking:
        told = _("The file has no column %(names)s.") % {"names": ", ".join(lacking)}
        raise BadDefinitionError([told])
    for cells in table[1:]:
        own = {column: cells[place] for column, place in places.items() if place < len(cells)}
        row = dict.fromkeys(COLUMNS, "") | own
        if row["name"].strip():
            trimmed = {name: row[name].strip() for name in ("name", "form", "matrix")}
            yield row | trimmed | {"type": row["type"].strip().lower()}


def _matrix_of(row: Row) -> tuple[Any, ...] | None:
    """Return what fields of one grid have in common; None for a field by itself. A matrix with more
    columns than a scale has points is asked field by field.
    """
    choices = choices_of(row["choices"])
    is_hidden = "@HIDDEN" in row["annotation"]
    if not row["matrix"] or row["type"] != "radio" or is_hidden:
        return None
    is_scale = MIN_POINTS <= len(choices) <= MAX_POINTS
    return (row["matrix"], row["branching"], tuple(choices)) if is_scale else None


def _title(form: str) -> str:
    return form.replace("_", " ").strip().capitalize()[:200]
