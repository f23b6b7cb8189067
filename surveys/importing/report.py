"""The report of an import: each part of the file that is changed or left out has a line in it."""

from enum import StrEnum

import msgspec
from django.utils.translation import gettext_lazy

EXCERPT = 120


class ImportOutcome(StrEnum):
    IMPORTED = "imported"
    CHANGED = "changed"
    LEFT_OUT = "left_out"


LABELS = {
    ImportOutcome.IMPORTED: gettext_lazy("imported"),
    ImportOutcome.CHANGED: gettext_lazy("changed"),
    ImportOutcome.LEFT_OUT: gettext_lazy("not imported"),
}


class NotImportedError(Exception):
    """A part of a file cannot be imported; the text is the reason."""


class Note(msgspec.Struct):
    """A line of the report: the `name` of a part in the file, its first words, the keys of the
    questions that it became, and changes or the reason for leaving it out.
    """

    name: str
    text: str = ""
    keys: list[str] = []
    remarks: list[str] = []
    outcome: ImportOutcome = ImportOutcome.IMPORTED

    def changed(self, words: str, **values: object) -> None:
        remark = clean(words % values if values else words)
        if remark not in self.remarks:
            self.remarks.append(remark)
        if self.outcome is ImportOutcome.IMPORTED:
            self.outcome = ImportOutcome.CHANGED

    def left_out(self, reason: str) -> None:
        self.keys = []
        self.remarks = [clean(reason)]
        self.outcome = ImportOutcome.LEFT_OUT

    @property
    def label(self) -> str:
        return str(LABELS[self.outcome])


class ImportReport(msgspec.Struct):
    """All notes in the order of the file; `system` is the product."""

    system: str
    notes: list[Note] = []

    def counts(self) -> list[tuple[ImportOutcome, str, int]]:
        found = [note.outcome for note in self.notes]
        return [(outcome, str(label), found.count(outcome)) for outcome, label in LABELS.items()]


def clean(text: str) -> str:
    """Return a text without what PostgreSQL refuses in JSON."""
    return text.replace("\x00", " ")


def excerpt(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= EXCERPT else line[: EXCERPT - 1].rstrip() + "…"
