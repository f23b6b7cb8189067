"""REDCap data dictionaries: a CSV file with a row for each field.

The columns are those of REDCap's data dictionary page, or of an export over the API, as in
IUREDCap/redcap-etl. Checked with the dictionaries in vubiostat/redcapAPI (every field type and
validation) and ReproNim/reproschema-py (a sample of the HBCD study: matrices, action tags,
branching).
"""

import csv
import io
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any, ClassVar

from django.utils.translation import gettext as _, gettext_lazy

from surveys.documents import BadDefinitionError, Text
from surveys.importing.draft import Draft, Item, SurveyFormat, language_of
from surveys.importing.question import ImportedQuestion, values_of
from surveys.importing.report import Note, NotImportedError
from surveys.problems import MAX_POINTS, MIN_POINTS

Row = Mapping[str, str]
_TAG = re.compile(r"@[A-Z][A-Z-]*(?:\s*=\s*(?:\"[^\"]*\"|'[^']*'|[^\s@]+))?")
# Tags that are imported, or have no effect on questions here.
_KNOWN_TAGS = frozenset(
    {
        *("@NONEOFTHEABOVE", "@MAXCHECKED", "@CHARLIMIT", "@WORDLIMIT", "@RANDOMORDER"),
        *("@INPUTMASK", "@HIDEBUTTON", "@FORCE-MINMAX", "@PASSWORDMASK", "@LATITUDE"),
    }
)
_YES = frozenset({"y", "yes", "1", "true"})
_REASONS = {
    "calc": gettext_lazy("Calculated fields are not questions; calculate them in the analysis."),
    "file": gettext_lazy("Files and signatures are not asked here."),
    "sql": gettext_lazy("Its options come from REDCap's database."),
}


class RedcapField(ImportedQuestion):
    def __init__(self, draft: Draft, note: Note, row: Row) -> None:
        super().__init__(draft, note, row["name"], row["type"])
        self.row = row
        found = (match.group().partition("=") for match in _TAG.finditer(row["annotation"]))
        self.tags = {tag.strip(): value.strip().strip("'\"") for tag, _sign, value in found}

    def text_of(self, text: str) -> Text:
        return self.draft.text({self.draft.languages[0]: text}, self.note)

    def text(self) -> Text:
        return self.or_name(self.text_of(self.row["label"]))

    def common(self) -> Item:
        hint = self.text_of(self.row["field_note"])
        return {"required": self._is_set("required"), "hint": hint}

    def _is_set(self, column: str) -> bool:
        return self.row[column].strip().lower() in _YES

    def items(self) -> list[Item]:
        if self.kind in _REASONS:
            raise NotImportedError(str(_REASONS[self.kind]))
        items = super().items()
        self._remark()
        return items

    def refuse_hidden(self) -> None:
        """Raise NotImportedError for a field that respondents do not see, or that is calculated."""
        if self.tags.keys() & {"@HIDDEN", "@HIDDEN-SURVEY"}:
            raise NotImportedError(_("It is hidden from respondents."))
        if self.tags.keys() & {"@CALCTEXT", "@CALCDATE"}:
            raise NotImportedError(str(_REASONS["calc"]))

    def _remark(self) -> None:
        if unknown := sorted(self.tags.keys() - _KNOWN_TAGS):
            self.note.changed(_("Not imported: %(what)s."), what=", ".join(unknown))
        words = _TAG.sub("", self.row["annotation"]).strip()
        self.note_reversal(words)
        if words and not any(words in remark for remark in self.note.remarks):
            self.note.changed(_("Its annotation is not imported: %(text)s"), text=words[:200])
        if self._is_set("identifier"):
            words = _(
                "The file marks its answers as identifying people. Be careful when you export them."
            )
            self.note.changed(words)

    def free_text(self) -> list[Item]:
        """text: a text, a number or a day, by its validation."""
        rule = self.row["validation"].strip().lower()
        bounds = [(one, self.row[one]) for one in ("min", "max")]
        if rule == "integer" or rule.startswith("number"):
            least, most = (self.number_bound(*one) for one in bounds)
            is_whole = rule == "integer"
            return [self.item("number", minimum=least, maximum=most, whole=is_whole)]
        if rule in {"date_ymd", "date_mdy", "date_dmy"}:
            first, last = (self.date_bound(*one) for one in bounds)
            return [self.item("date", earliest=first, latest=last)]
        if rule:
            self.note.changed(_("Its format (%(rule)s) is not checked."), rule=rule)
        return [self.item("text", max_length=self._length(is_line=True))]

    def notes(self) -> list[Item]:
        """notes: a text of several lines."""
        return [self.item("text", lines=5, max_length=self._length(is_line=False))]

    def _length(self, *, is_line: bool) -> int:
        return self.length(_whole(self.tags.get("@CHARLIMIT", "")), is_line=is_line)

    def _labels(self) -> dict[str, Text]:
        if self.kind in {"yesno", "truefalse"}:
            names = ("yes", "no") if self.kind == "yesno" else ("true", "false")
            return dict(zip(("1", "0"), map(self.word, names), strict=True))
        return {code: self.text_of(label) for code, label in choices_of(self.row["choices"])}

    def _order(self) -> str:
        return "shuffled" if "@RANDOMORDER" in self.tags else "fixed"

    def one_choice(self) -> list[Item]:
        """radio, dropdown, yesno, truefalse: one of its choices."""
        options = self.options(self._labels())
        item = self.item("single", options=list(options.values()), order=self._order())
        self.draft.remember(self.name, item["key"], values_of(options))
        return [item]

    def several(self) -> list[Item]:
        """checkbox: any of its choices."""
        alone = [one.strip() for one in self.tags.get("@NONEOFTHEABOVE", "").split(",")]
        options = self.options(self._labels(), alone)
        most = _whole(self.tags.get("@MAXCHECKED", ""))
        bound = most if most is not None and 0 < most <= len(options) else None
        found = list(options.values())
        item = self.item("multiple", options=found, at_most=bound, order=self._order())
        for code, option in options.items():
            self.draft.remember(f"{self.name}({code})", item["key"], {"1": option["value"]})
        return [item]

    def sliders(self) -> list[Item]:
        """slider: a whole number between two ends, whose labels are those of the choices."""
        labels = [self.text_of(one) for one in self.row["choices"].split("|") if one.strip()]
        low, high = _whole(self.row["min"]), _whole(self.row["max"])
        if len(labels) > 2:
            self.note.changed(_("Labels between the two ends are not imported."))
        ends = (labels[0], labels[-1]) if len(labels) > 1 else ({}, {})
        fields = self.slider(0 if low is None else low, 100 if high is None else high, *ends)
        return [self.item(**fields)]

    TYPES: ClassVar[Mapping[str, Callable[["RedcapField"], list[Item]]]] = {
        "text": free_text,
        "notes": notes,
        **dict.fromkeys(("radio", "dropdown", "select", "yesno", "truefalse"), one_choice),
        "checkbox": several,
        "slider": sliders,
    }

    def grid(self, fields: Sequence["RedcapField"], heading: Text) -> Item:
        name, values, reasons = self.scale(self._labels())
        required = [bool(field.common().get("required")) for field in fields]
        if any(required) and not all(required):
            words = _("The file requires an answer in some rows only; here all rows are optional.")
            self.note.changed(words)
        if any(field._is_set("ranking") for field in fields):  # noqa: SLF001 - another of this class
            self.note.changed(_("Respondents can choose a column in several rows."))
        rows = []
        for field in fields:
            key = field.key()
            rows.append({"key": key, "text": field.text()})
            self.draft.remember(field.name, key, values)
            field._remark()  # noqa: SLF001 - another of this class
        own = {"key": self.draft.key(self.row["matrix"], self.note), "kind": "grid", "rows": rows}
        text = heading or self.draft.same(self.row["matrix"])
        return {**own, "text": text, "scale": name, "required": all(required), **reasons}


def choices_of(text: str) -> list[tuple[str, str]]:
    """Return codes and labels of `1, Yes | 2, No`; older dictionaries have a choice a line."""
    parts = text.split("|") if "|" in text else text.splitlines()
    pairs = [part.partition(",") for part in parts if part.strip()]
    return [(code.strip(), (label if comma else code).strip()) for code, comma, label in pairs]


def _whole(text: str) -> int | None:
    return int(text) if re.fullmatch(r"-?\d{1,9}", text.strip()) else None


# --- the file -------------------------------------------------------------------------------------

# The columns, with their headings in a dictionary and in an export over the API.
with Path(__file__).with_suffix(".csv").open(encoding="utf-8", newline="") as _file:
    COLUMNS = {row["column"]: (row["dictionary"], row["api"]) for row in csv.DictReader(_file)}
MAX_CELL = 100_000  # characters
_OR = re.compile(r"\bor\b", re.IGNORECASE)
# One comparison of a branching logic: [field] = '1', [field(2)] = "1".
_COMPARISON = re.compile(
    r"""\[(?P<name>[a-z][a-z0-9_]*(?:\([^()]+\))?)\]\s*=\s*(?P<answer>'[^']*'|"[^"]*"|-?\d+)"""
)


class Redcap(SurveyFormat):
    label: ClassVar[str] = "REDCap (.csv)"

    def __init__(self, document: bytes, language: str, form: str) -> None:
        rows = list(rows_of(document))
        self.first = rows[0] if rows else None
        forms = list(dict.fromkeys(row["form"] for row in rows))
        if form and form not in forms:
            words = _("The file has no form “%(form)s”; it has %(forms)s.")
            values = {"form": form, "forms": ", ".join(forms)[:1000]}
            raise BadDefinitionError([words % values])
        self.rows = [row for row in rows if form in {"", row["form"]}]
        self.others = [one for one in forms if form not in {"", one}]
        self.form = form or (forms[0] if len(forms) == 1 else "")
        languages = [language_of(language) or "en"]
        self.into = Draft("redcap", self.label, languages, keeps_lines=True)

    @classmethod
    def is_in(cls, document: bytes) -> bool:
        head = document[:2000].lower()
        needed = (COLUMNS[column] for column in ("name", "form"))
        return all(any(name.encode() in head for name in names) for names in needed)

    def convert(self) -> None:
        self.into.title = self.into.same(_title(self.form) or "REDCap")
        self.into.source = f"REDCap, {self.form}" if self.form else "REDCap"
        for form, rows in groupby(self.rows, key=lambda row: row["form"]):
            self.into.page(self.into.same(_title(form)) if form and not self.form else {}, {})
            for matrix, run in groupby(rows, key=_matrix_of):
                if matrix is not None:
                    self._grid(list(run))
                else:
                    for row in run:
                        self._field(row)
        for form in self.others:
            self.into.leave_out(form, _("It belongs to a form that you did not choose."))

    def _field(self, row: Row) -> None:
        note = self.into.note(row["name"], row["label"])
        if row is self.first:
            words = _(
                "The first field identifies the record. Here, each respondent has a key instead."
            )
            note.left_out(words)
            return
        with self.into.trying(note):
            field = RedcapField(self.into, note, row)
            field.refuse_hidden()
            if row["header"].strip():
                heading = self._heading(row)
                is_short = all(len(one) <= 120 and "\n" not in one for one in heading.values())
                self.into.page(heading if is_short else {}, {} if is_short else heading)
            if row["type"] == "descriptive":
                self.into.introduce(note, field.text_of(row["label"]))
                if row["branching"].strip():
                    note.changed(_("Its condition is not imported: it is shown to everybody."))
            else:
                condition = self._condition(note, row)
                self.into.ask(note, field.items(), condition)

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
                words = _("Its matrix has no heading, so the name of the matrix is shown.")
                notes[0].changed(words)
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
    """Yield rows with all COLUMNS; raises BadDefinitionError for no CSV or lacking columns."""
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
        words = _("This is not a valid CSV file: %(problem)s.") % {"problem": error}
        raise BadDefinitionError([words]) from error
    headings = [one.strip().strip('"').lower() for one in table[0]]
    columns = ((column, name) for column, names in COLUMNS.items() for name in reversed(names))
    places = {column: headings.index(name) for column, name in columns if name in headings}
    lacking = [COLUMNS[one][0] for one in ("name", "type", "label") if one not in places]
    if lacking:
        words = _("The file has no column %(names)s.") % {"names": ", ".join(lacking)}
        raise BadDefinitionError([words])
    for cells in table[1:]:
        own = {column: cells[place] for column, place in places.items() if place < len(cells)}
        row = dict.fromkeys(COLUMNS, "") | own
        if row["name"].strip():
            trimmed = {name: row[name].strip() for name in ("name", "form", "matrix")}
            yield row | trimmed | {"type": row["type"].strip().lower()}


def _matrix_of(row: Row) -> tuple[Any, ...] | None:
    """Return a key of the grid that a field belongs to; None for a field by itself, as those of a
    matrix with more columns than a scale has points.
    """
    if not row["matrix"] or row["type"] != "radio" or "@HIDDEN" in row["annotation"]:
        return None
    choices = tuple(choices_of(row["choices"]))
    is_scale = MIN_POINTS <= len(choices) <= MAX_POINTS
    return (row["matrix"], row["branching"], choices) if is_scale else None


def _title(form: str) -> str:
    return form.replace("_", " ").strip().capitalize()[:200]
