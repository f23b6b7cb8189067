"""The fields of a REDCap data dictionary as questions of this site, by type and validation."""

import re
from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar

from django.utils.translation import gettext as _
from django.utils.translation import gettext_lazy

from surveys.documents import Text
from surveys.importing.draft import Draft, Item, given
from surveys.importing.question import ImportedQuestion
from surveys.importing.report import Note, NotImportedError

Row = Mapping[str, str]
_TAG = re.compile(r"@[A-Z][A-Z-]*(?:\s*=\s*(?:\"[^\"]*\"|'[^']*'|[^\s@]+))?")
# Tags that are taken over, or change nothing of what is asked here.
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
    """One row of the dictionary."""

    def __init__(self, draft: Draft, note: Note, row: Row) -> None:
        super().__init__(draft, note, row["name"], row["type"])
        self.row = row
        found = (match.group().partition("=") for match in _TAG.finditer(row["annotation"]))
        self.tags = {tag.strip(): value.strip().strip("'\"") for tag, _sign, value in found}

    def text_of(self, text: str) -> Text:
        """Return a text of the file, which has one language."""
        return self.draft.text({self.draft.languages[0]: text}, self.note)

    def text(self) -> Text:
        return self.or_name(self.text_of(self.row["label"]))

    def common(self) -> Item:
        return given(required=self._says("required"), hint=self.text_of(self.row["field_note"]))

    def _says(self, column: str) -> bool:
        return self.row[column].strip().lower() in _YES

    def items(self) -> list[Item]:
        if self.kind in _REASONS:
            raise NotImportedError(str(_REASONS[self.kind]))
        items = super().items()
        self._remark()
        return items

    def refuse_hidden(self) -> None:
        """Refuse a field that respondents do not see, or that REDCap fills in.

        Raises:
            NotImportedError: it is one.
        """
        if self.tags.keys() & {"@HIDDEN", "@HIDDEN-SURVEY"}:
            raise NotImportedError(_("It is hidden from respondents."))
        if self.tags.keys() & {"@CALCTEXT", "@CALCDATE"}:
            raise NotImportedError(str(_REASONS["calc"]))

    def _remark(self) -> None:
        """Note what of a field is not taken over."""
        if unknown := sorted(self.tags.keys() - _KNOWN_TAGS):
            self.note.changed(_("Not imported: %(what)s."), what=", ".join(unknown))
        words = _TAG.sub("", self.row["annotation"]).strip()
        self.note_reversal(words)
        if words and not any(words in remark for remark in self.note.remarks):
            self.note.changed(_("Its annotation is not imported: %(text)s"), text=words[:200])
        if self._says("identifier"):
            self.note.changed(
                _(
                    "The file marks its answers as identifying people. Be careful when you export "
                    "them."
                )
            )

    # types

    def free_text(self) -> list[Item]:
        """text: a text, a number or a day, by its validation."""
        rule = self.row["validation"].strip().lower()
        if rule == "integer" or rule.startswith("number"):
            least, most = self._bound("min"), self._bound("max")
            is_whole = rule == "integer"
            return [self.item("number", minimum=least, maximum=most, whole=is_whole)]
        if rule in {"date_ymd", "date_mdy", "date_dmy"}:
            return [self.item("date", earliest=self._day("min"), latest=self._day("max"))]
        if rule:
            self.note.changed(_("Its format (%(rule)s) is not checked."), rule=rule)
        return [self.item("text", max_length=self._length(is_line=True))]

    def notes(self) -> list[Item]:
        """notes: a text of several lines."""
        return [self.item("text", lines=5, max_length=self._length(is_line=False))]

    def _length(self, *, is_line: bool) -> int:
        return self.length(_whole(self.tags.get("@CHARLIMIT", "")), is_line=is_line)

    def _bound(self, column: str) -> float | None:
        value = self.row[column].strip().replace(",", ".")
        if re.fullmatch(r"-?\d{1,15}(\.\d+)?", value):
            return float(value)
        if value:
            self.unchecked(f"{column} {value[:60]}")
        return None

    def _day(self, column: str) -> str:
        value = self.row[column].strip().lower()
        if value in {"today", "now"}:
            return "today"
        if value and not re.fullmatch(r"\d{4}-\d{2}-\d{2}", value):
            self.unchecked(f"{column} {value}")
            return ""
        return value

    def _labels(self) -> dict[str, Text]:
        if self.kind in {"yesno", "truefalse"}:
            names = ("yes", "no") if self.kind == "yesno" else ("true", "false")
            return dict(zip(("1", "0"), map(self.word, names), strict=True))
        return {code: self.text_of(label) for code, label in choices_of(self.row["choices"])}

    def _order(self) -> str:
        return "shuffled" if "@RANDOMORDER" in self.tags else ""

    def one_choice(self) -> list[Item]:
        """radio, dropdown, yesno, truefalse: one of its choices."""
        options = self.options(self._labels())
        item = self.item("single", options=list(options.values()), order=self._order())
        for code, option in options.items():
            self.draft.remember(self.name, code, item["key"], option["value"])
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
            self.draft.remember(f"{self.name}({code})", "1", item["key"], option["value"])
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

    # matrices

    def grid(self, fields: Sequence["RedcapField"], heading: Text) -> Item:
        """Return the grid of the fields of one matrix of radio buttons, of which this is the
        first.
        """
        labels = self._labels()
        name, values, reasons = self.scale({code: (code, one) for code, one in labels.items()})
        required = [bool(field.common().get("required")) for field in fields]
        if any(required) and not all(required):
            self.note.changed(
                _("The file requires an answer in some rows only; here all rows are optional.")
            )
        if any(field._says("ranking") for field in fields):  # noqa: SLF001 - another of this class
            self.note.changed(_("Respondents can choose a column in several rows."))
        rows = []
        for field in fields:
            key = field.key()
            rows.append({"key": key, "text": field.text()})
            for code, value in values.items():
                self.draft.remember(field.name, code, key, value)
            field._remark()  # noqa: SLF001 - another of this class
        own = {"key": self.draft.key(self.row["matrix"], self.note), "kind": "grid", "rows": rows}
        text = heading or self.draft.same(self.row["matrix"])
        return {**own, "text": text, "scale": name, **given(required=all(required)), **reasons}


def choices_of(text: str) -> list[tuple[str, str]]:
    """Return codes and labels of `1, Yes | 2, No`; older dictionaries write a choice a line."""
    parts = text.split("|") if "|" in text else text.splitlines()
    pairs = [part.partition(",") for part in parts if part.strip()]
    return [(code.strip(), (label if comma else code).strip()) for code, comma, label in pairs]


def _whole(text: str) -> int | None:
    return int(text) if re.fullmatch(r"-?\d{1,9}", text.strip()) else None
