"""Informed consent, and the texts of a new study's. A placeholder is a name in double brackets,
`[[institution]]`; publishing refuses a text that still has one.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from experiments.definition.step import Step, Version
from surveys.documents import Problem, Text, gettext_noop as _

PLACEHOLDER = re.compile(r"\[\[[^\[\]]+\]\]")
TEXTS = Path(__file__).resolve().parents[2] / "definitions"


def _by_language(name: str) -> Mapping[str, str]:
    """Return the texts of a folder by language; studies in other languages start with English."""
    files = (TEXTS / name).glob("*.txt")
    return {path.stem: path.read_text(encoding="utf-8").rstrip("\n") for path in files}


TEMPLATE, SHARING = _by_language("consent"), _by_language("sharing")


class Consent(Step, frozen=True, kw_only=True, tag="consent"):
    """The participant agrees to `text`, or leaves. Participants younger than `minimum_age` are
    turned away, or need a guardian's agreement. `sharing` is the text of an optional tick:
    public datasets contain only those who set it.
    """

    may_repeat: ClassVar[bool] = False
    is_for_good: ClassVar[bool] = True

    version: Version = 1
    text: Text
    sharing: Text = {}
    minimum_age: Annotated[int, Meta(ge=0, le=99)] = 18
    minors: Literal["refused", "guardian"] = "refused"

    def unfilled(self) -> Iterator[Problem]:
        """Yield one problem with the placeholders that the text still has, by language."""
        found = {
            language: ", ".join(dict.fromkeys(PLACEHOLDER.findall(text)))
            for language, text in self.text.items()
        }
        listed = "; ".join(f"{language}: {names}" for language, names in found.items() if names)
        if listed:
            words = _("fill in the placeholders of the text. %(placeholders)s.")
            yield Problem(words, {"placeholders": listed})

    @classmethod
    def problems_among(cls, steps: Sequence[Step]) -> Iterator[Problem]:
        count = sum(isinstance(step, cls) for step in steps)
        if count > 1:
            yield Problem(_("There are %(n)d consent steps; only one is allowed."), {"n": count})
        if count and not isinstance(steps[0], cls):
            yield Problem(_("The consent must be the first step."))
