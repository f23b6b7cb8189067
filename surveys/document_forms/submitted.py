"""What came in with a form of a part: the part as it was typed, and the button that was pressed."""

from dataclasses import dataclass, field
from typing import Any

from django.utils.translation import gettext_lazy

from surveys.document_forms.parts import Document

MEANWHILE = gettext_lazy(
    "Not saved: someone else changed this draft. If your change still applies, submit it again."
)


@dataclass
class SubmittedPart:
    """A form as it came in: `part` as typed, `errors` by name of the field, `above` what no field
    is to blame for, `anchor` where to go on.
    """

    part: Document
    errors: dict[str, str] = field(default_factory=dict)
    above: list[str] = field(default_factory=list)
    anchor: str = ""


def pressed(sent: Any, count: int = 3) -> list[str]:
    """Return the words that a button says, `verb:list:n` for most; empty where it says less."""
    said = sent.get("do", "").split(":")
    return [*said, *[""] * count][:count]


def number(text: str) -> int:
    """Return the number of a part of a list that a button says; -1, which no part has, when it is
    none.
    """
    return int(text[:6]) if text.isascii() and text.isdigit() else -1
