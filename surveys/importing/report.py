"""What became of each part of a file that was imported: nothing is left out without a line here."""

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
    """A part of a file that has no counterpart here; the text says why."""


class Note(msgspec.Struct):
    """A line of the report. `name` is what the file calls it, `text` its first words, `keys` are
    the questions that it became, `remarks` say what is different, or why it was not imported.
    """

    name: str
    text: str = ""
    keys: list[str] = []
    remarks: list[str] = []
    outcome: ImportOutcome = ImportOutcome.IMPORTED

    def changed(self, words: str, **values: object) -> None:
        """Add a remark: words, filled in with values."""
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
    """All of them, in the order of the file. `system` is where the file comes from."""

    system: str
    notes: list[Note] = []

    def counts(self) -> list[tuple[ImportOutcome, str, int]]:
        """Return how many lines have each outcome."""
        found = [note.outcome for note in self.notes]
        return [(outcome, str(label), found.count(outcome)) for outcome, label in LABELS.items()]


def clean(text: str) -> str:
    """Return a text without what PostgreSQL refuses in JSON."""
    return text.replace("\x00", " ")


def excerpt(text: str) -> str:
    """Return the first words of a text on one line."""
    line = " ".join(text.split())
    return line if len(line) <= EXCERPT else line[: EXCERPT - 1].rstrip() + "…"
