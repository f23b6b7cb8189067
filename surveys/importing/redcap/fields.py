"""The fields of a REDCap data dictionary as questions of this site, by type and validation."""

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from django.utils.translation import gettext as _
from django.utils.translation import gettext_lazy

from surveys.documents import Text
from surveys.importing.draft import Draft, Item
from surveys.importing.parts import (
    flags,
    note_reversal,
    options,
    remember_options,
    scale,
    word,
)
from surveys.importing.report import Note, NotImportedError

Row = Mapping[str, str]
_TAG = re.compile(r"@[A-Z][A-Z-]*(?:\s*=\s*(?:\"[^\"]*\"|'[^']*'|[^\s@]+))?")
# Tags that change nothing of what is asked here.
_QUIET_TAGS = frozenset(
    {"@INPUTMASK", "@HIDEBUTTON", "@FORCE-MINMAX", "@PASSWORDMASK", "@LATITUDE"}
)
_OWN_TAGS = frozenset(
    {"@NONEOFTHEABOVE", "@MAXCHECKED", "@CHARLIMIT", "@WORDLIMIT", "@RANDOMORDER"}
)
_DATES = re.compile(r"^date_(ymd|mdy|dmy)$")


class RedcapField:
    """One row of the dictionary."""

    def __init__(self, draft: Draft, note: Note, row: Row) -> None:
        self.draft = draft
        self.note = note
        self.row = row
        self.name = row["name"]
        self.tags = _tags(row["annotation"])

    def text(self) -> Text:
        """Return the question; the field's name where it has none."""
        text = self.one_text(self.row["label"])
        if not text:
            self.note.changed(_("It has no text; its name is shown."))
        return text or self.draft.same(self.name)

    def one_text(self, text: str) -> Text:
        """Return a text of the file, which has one language."""
        return self.draft.text({self.draft.languages[0]: text}, self.note)

    def labels(self) -> dict[str, Text]:
        """Return the labels of the choices by code: `1, Yes | 2, No`."""
        return {code: self.one_text(label) for code, label in choices_of(self.row["choices"])}

    def common(self) -> Item:
        """Return the fields that every item made of it has."""
        return flags(
            required=self.row["required"].strip().lower() in {"y", "yes", "1", "true"},
            hint=self.one_text(self.row["field_note"]),
        )

    def item(self, kind: str, **more: Any) -> Item:
        """Return the item of this field."""
        key = self.draft.key(self.name, self.note)
        return {"kind": kind, "key": key, "text": self.text(), **self.common(), **more}


def choices_of(text: str) -> list[tuple[str, str]]:
    """Return codes and labels of `1, Yes | 2, No`; older dictionaries write a choice a line."""
    parts = text.split("|") if "|" in text else text.splitlines()
    pairs = [part.partition(",") for part in parts if part.strip()]
    return [(code.strip(), (label if comma else code).strip()) for code, comma, label in pairs]


def _tags(annotation: str) -> dict[str, str]:
    found = (match.group().partition("=") for match in _TAG.finditer(annotation))
    return {tag.strip(): value.strip().strip("'\"") for tag, _sign, value in found}


def _whole(text: str) -> int | None:
    return int(text) if re.fullmatch(r"-?\d{1,9}", text.strip()) else None


# --- field types ----------------------------------------------------------------------------------


def text_field(field: RedcapField) -> Item:
    """text: a text, a number or a day, by its validation."""
    rule = field.row["validation"].strip().lower()
    if rule == "integer" or rule.startswith("number"):
        return field.item("number", **_bounds(field), **flags(whole=rule == "integer"))
    if _DATES.match(rule):
        return field.item("date", **_days(field))
    if rule:
        field.note.changed(_("Its format (%(rule)s) is not checked.") % {"rule": rule})
    return field.item("text", **_length(field, 1000))


def notes(field: RedcapField) -> Item:
    """notes: a text of several lines."""
    return field.item("text", lines=5, **_length(field, 5000))


def _length(field: RedcapField, usual: int) -> Item:
    most = _whole(field.tags.get("@CHARLIMIT", ""))
    return {"max_length": most if most is not None and 1 <= most <= 5000 else usual}


def _bounds(field: RedcapField) -> Item:
    bounds: Item = {}
    for name, column in (("minimum", "min"), ("maximum", "max")):
        value = field.row[column].strip().replace(",", ".")
        if re.fullmatch(r"-?\d{1,15}(\.\d+)?", value):
            bounds[name] = float(value)
        elif value:
            field.note.changed(
                _("Its rule %(rule)s is not checked.") % {"rule": f"{column} {value[:60]}"}
            )
    return bounds


def _days(field: RedcapField) -> Item:
    days: Item = {}
    for name, column in (("earliest", "min"), ("latest", "max")):
        value = field.row[column].strip().lower()
        if value in {"today", "now"}:
            days[name] = "today"
        elif re.fullmatch(r"\d{4}-\d{2}-\d{2}", value):
            days[name] = value
        elif value:
            field.note.changed(
                _("Its rule %(rule)s is not checked.") % {"rule": f"{column} {value}"}
            )
    return days


def one_choice(field: RedcapField) -> Item:
    """radio, dropdown: one of its choices."""
    return _choice(field, field.labels())


def two_words(field: RedcapField) -> Item:
    """yesno, truefalse: 1 or 0."""
    names = ("yes", "no") if field.row["type"] == "yesno" else ("true", "false")
    labels = {
        code: word(name, field.draft, field.note)
        for code, name in zip(("1", "0"), names, strict=True)
    }
    return _choice(field, labels)


def _choice(field: RedcapField, labels: dict[str, Text]) -> Item:
    item = field.item("single", options=options(labels, field.note), **_order(field))
    remember_options(field.draft, field.name, labels, item["key"])
    return item


def several(field: RedcapField) -> Item:
    """checkbox: any of its choices."""
    labels = field.labels()
    alone = [one.strip() for one in field.tags.get("@NONEOFTHEABOVE", "").split(",")]
    found = options(labels, field.note, alone)
    most = _whole(field.tags.get("@MAXCHECKED", ""))
    bounds = {"at_most": most} if most is not None and 0 < most <= len(found) else {}
    item = field.item("multiple", options=found, **bounds, **_order(field))
    values = (option["value"] for option in found)
    for code in (code for code, label in labels.items() if label):
        field.draft.remember(f"{field.name}({code.lower()})", "1", item["key"], next(values))
    return item


def _order(field: RedcapField) -> Item:
    return flags(order="shuffled" if "@RANDOMORDER" in field.tags else "")


def slider(field: RedcapField) -> Item:
    """slider: a whole number between two ends, whose labels are those of the choices."""
    labels = [field.one_text(label) for label in field.row["choices"].split("|") if label.strip()]
    low, high = _whole(field.row["min"]), _whole(field.row["max"])
    least, most = 0 if low is None else low, 100 if high is None else high
    if len(labels) > 2:
        field.note.changed(_("Labels between the two ends are not imported."))
    ends = (labels[0], labels[-1]) if len(labels) > 1 else (None, None)
    return field.item(
        "slider",
        minimum=least,
        maximum=most,
        low=ends[0] or field.draft.same(str(least)),
        high=ends[1] or field.draft.same(str(most)),
    )


TYPES: dict[str, Callable[[RedcapField], Item]] = {
    "text": text_field,
    "notes": notes,
    "radio": one_choice,
    "dropdown": one_choice,
    "select": one_choice,
    "checkbox": several,
    "yesno": two_words,
    "truefalse": two_words,
    "slider": slider,
}
REASONS = {
    "calc": gettext_lazy("Calculated fields are not questions; calculate them in the analysis."),
    "file": gettext_lazy("Files and signatures are not asked here."),
    "sql": gettext_lazy("Its options come from REDCap's database."),
}


def item_of(field: RedcapField) -> Item:
    """Return what a field becomes.

    Raises:
        NotImportedError: it has no counterpart here.
    """
    kind = field.row["type"]
    refuse_hidden(field)
    if kind not in TYPES:
        reason = _("Questions of the type %(kind)s are not supported.") % {"kind": kind}
        raise NotImportedError(str(REASONS.get(kind, reason)))
    item = TYPES[kind](field)
    remark(field)
    return item


def refuse_hidden(field: RedcapField) -> None:
    """Refuse a field that respondents do not see, or that REDCap fills in.

    Raises:
        NotImportedError: it is one.
    """
    if field.tags.keys() & {"@HIDDEN", "@HIDDEN-SURVEY"}:
        raise NotImportedError(_("It is hidden from respondents."))
    if field.tags.keys() & {"@CALCTEXT", "@CALCDATE"}:
        raise NotImportedError(str(REASONS["calc"]))


def remark(field: RedcapField) -> None:
    """Note what of a field is not taken over."""
    unknown = sorted(field.tags.keys() - _OWN_TAGS - _QUIET_TAGS)
    if unknown:
        field.note.changed(_("Not imported: %(what)s.") % {"what": ", ".join(unknown)})
    words = _TAG.sub("", field.row["annotation"]).strip()
    note_reversal(field.note, words)
    if words and not any(words in remark_ for remark_ in field.note.remarks):
        field.note.changed(_("Its annotation is not imported: %(text)s") % {"text": words[:200]})
    if field.row["identifier"].strip().lower() in {"y", "yes"}:
        field.note.changed(
            _("The file marks its answers as identifying people. Be careful when you export them.")
        )


# --- matrices -------------------------------------------------------------------------------------


def grid(fields: Sequence[RedcapField], heading: Text) -> Item:
    """Return the grid of the fields of one matrix of radio buttons; its notes are the first's."""
    first = fields[0]
    draft, note = first.draft, first.note
    labels = first.labels()
    name, values, reasons = scale(
        draft, note, {code: (code, label) for code, label in labels.items()}
    )
    required = [bool(field.common().get("required")) for field in fields]
    if any(required) and not all(required):
        note.changed(
            _("The file requires an answer in some rows only; here all rows are optional.")
        )
    if any(field.row["ranking"].strip().lower() in {"y", "yes"} for field in fields):
        note.changed(_("Respondents can choose a column in several rows."))
    rows = []
    for field in fields:
        key = draft.key(field.name, field.note)
        field.note.keys = [key]
        rows.append({"key": key, "text": field.text()})
        for code, value in values.items():
            draft.remember(field.name, code, key, value)
        remark(field)
    return {
        "kind": "grid",
        "key": draft.key(first.row["matrix"], note),
        "text": heading or draft.same(first.row["matrix"]),
        "scale": name,
        "rows": rows,
        **flags(required=all(required)),
        **reasons,
    }
