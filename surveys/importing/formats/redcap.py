"""REDCap data dictionaries: a CSV file with a row for each field.

The eighteen columns are those that REDCap documents on its data dictionary page. Read against the
dictionaries in vubiostat/redcapAPI (every field type and validation) and ReproNim/reproschema-py (a
sample of the HBCD study: matrices, action tags, branching); the names of the columns in an export
over the API are understood, too, as in IUREDCap/redcap-etl.
"""

import csv
import io
import re
from collections.abc import Iterator
from itertools import groupby
from typing import Any, ClassVar

from django.utils.translation import gettext as _

from surveys.documents import BadDefinitionError, Text
from surveys.importing.draft import Draft, language_of
from surveys.importing.redcap.fields import (
    RedcapField,
    Row,
    choices_of,
    grid,
    item_of,
    refuse_hidden,
)
from surveys.importing.report import Note
from surveys.importing.survey_format import SurveyFormat, Wishes

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
_NEEDED = ("name", "type", "label")
MAX_CELL = 100_000
# One comparison of a branching logic: [field] = '1', [field(2)] = "1".
_COMPARED = re.compile(
    r"""^\(*\s*\[(?P<name>[a-z][a-z0-9_]*(?:\([^()]+\))?)\]\s*=\s*
    (?:'(?P<one>[^']*)'|"(?P<two>[^"]*)"|(?P<three>-?\d+))\s*\)*$""",
    re.VERBOSE,
)


class Redcap(SurveyFormat):
    """A data dictionary of REDCap."""

    label: ClassVar[str] = "REDCap (.csv)"

    @classmethod
    def is_in(cls, document: bytes) -> bool:
        """Tell by the headings of its first two columns."""
        head = document[:2000].lower()
        return any(name.encode() in head for name in COLUMNS["name"]) and any(
            name.encode() in head for name in COLUMNS["form"]
        )

    @classmethod
    def read(cls, document: bytes, wishes: Wishes) -> Draft:
        """Return what a file asks.

        Raises:
            BadDefinitionError: it is no such file, or has no such form.
        """
        return _RedcapConversion(list(rows_of(document)), wishes).draft()


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
        raise BadDefinitionError(
            [_("This is not a valid CSV file: %(problem)s.") % {"problem": error}]
        ) from error
    headings = [one.strip().strip('"').lower() for one in table[0]]
    places = {
        column: next((headings.index(name) for name in names if name in headings), None)
        for column, names in COLUMNS.items()
    }
    lacking = [COLUMNS[column][0] for column in _NEEDED if places[column] is None]
    if lacking:
        raise BadDefinitionError(
            [_("The file has no column %(names)s.") % {"names": ", ".join(lacking)}]
        )
    for cells in table[1:]:
        row = {
            column: cells[place] if place is not None and place < len(cells) else ""
            for column, place in places.items()
        }
        if row["name"].strip():
            trimmed = {name: row[name].strip() for name in ("name", "form", "matrix")}
            yield row | trimmed | {"type": row["type"].strip().lower()}


class _RedcapConversion:
    """One file, field by field."""

    def __init__(self, rows: list[Row], wishes: Wishes) -> None:
        self.first = rows[0] if rows else None
        forms = list(dict.fromkeys(row["form"] for row in rows))
        if wishes.form and wishes.form not in forms:
            raise BadDefinitionError(
                [
                    _("The file has no form “%(form)s”; it has %(forms)s.")
                    % {"form": wishes.form, "forms": ", ".join(forms)[:1000]}
                ]
            )
        self.rows = [row for row in rows if wishes.form in {"", row["form"]}]
        self.others = [form for form in forms if wishes.form not in {"", form}]
        self.form = wishes.form or (forms[0] if len(forms) == 1 else "")
        self.into = Draft(
            "redcap", Redcap.label, [language_of(wishes.language) or "en"], keeps_lines=True
        )

    def draft(self) -> Draft:
        """Return what it asks."""
        self.into.title = self.into.same(_title(self.form) or "REDCap")
        self.into.source = f"REDCap, {self.form}" if self.form else "REDCap"
        for form, rows in groupby(self.rows, key=lambda row: row["form"]):
            self.into.page(self.into.same(_title(form)) if form and not self.form else {})
            self._take_form(list(rows))
        for form in self.others:
            self.into.leave_out(form, _("It belongs to a form that you did not choose."))
        self.into.finish()
        return self.into

    def _take_form(self, rows: list[Row]) -> None:
        for _group, run in groupby(rows, key=_matrix_of):
            fields = list(run)
            if _matrix_of(fields[0]) is None:
                for row in fields:
                    self._field(row)
            else:
                self._grid(fields)

    def _field(self, row: Row) -> None:
        note = self.into.note(row["name"], row["label"])
        with self.into.trying(note):
            if row is self.first:
                note.left_out(
                    _(
                        "The first field identifies the record. Here, each respondent "
                        "has a key instead."
                    )
                )
                return
            field = RedcapField(self.into, note, row)
            refuse_hidden(field)
            if row["type"] == "descriptive":
                self._section(row)
                self.into.say(note, field.one_text(row["label"]))
                if row["branching"].strip():
                    note.changed(_("Its condition is not imported: it is shown to everybody."))
                return
            self._section(row)
            condition = self._condition(note, row["branching"])
            item = item_of(field)
            self.into.ask(note, [{"show_if": condition} | item if condition else item])

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
            condition = self._condition(notes[0], rows[0]["branching"])
            item = grid(fields, heading)
            keys = [note.keys for note in notes]
            self.into.ask(notes[0], [{"show_if": condition} | item if condition else item])
            for note, own in zip(notes, keys, strict=True):
                note.keys = own
            return
        for note in notes[1:]:
            note.left_out(notes[0].remarks[0])

    def _condition(self, note: Note, logic: str) -> dict[str, Any] | None:
        """Return `show_if` for comparisons of one field with choices, joined by "or"; anything else
        is noted.
        """
        if not logic.strip():
            return None
        found = [
            _COMPARED.match(part.strip())
            for part in re.split(r"\bor\b", logic.strip(), flags=re.IGNORECASE)
        ]
        condition = None
        if all(found):
            condition = self.into.condition(
                (one["name"].lower(), one["one"] or one["two"] or one["three"] or "")
                for one in found
                if one is not None
            )
        if condition is None:
            note.changed(
                _("Its condition is not imported: it is shown to everybody (%(condition)s).")
                % {"condition": " ".join(logic.split())[:100]}
            )
        return condition


def _matrix_of(row: Row) -> tuple[Any, ...] | None:
    """Return what fields of one grid have in common; None for a field by itself. A matrix with more
    columns than a scale has points is asked field by field.
    """
    choices = choices_of(row["choices"])
    is_hidden = "@HIDDEN" in row["annotation"]
    if not row["matrix"] or row["type"] != "radio" or is_hidden or not 2 <= len(choices) <= 11:
        return None
    return (row["matrix"], row["branching"], tuple(choices))


def _title(form: str) -> str:
    return form.replace("_", " ").strip().capitalize()[:200]
