"""Free text."""

import datetime
from collections.abc import Sequence
from typing import Annotated, Any, ClassVar

import msgspec
from django.utils.translation import gettext as _
from django.utils.translation import gettext_lazy

from surveys.item import Item, Question, RefusedError, Viewing, Widget, first_choice


class TextItem(Item, frozen=True, kw_only=True, tag="text"):
    """Free text on one line or several."""

    plain_name: ClassVar[Any] = gettext_lazy("Free text")
    is_free_text: ClassVar[bool] = True

    lines: Annotated[int, msgspec.Meta(ge=1, le=20)] = 1
    max_length: Annotated[int, msgspec.Meta(ge=1, le=5000)] = 1000

    def parse(self, question: Question, values: Sequence[str], now: datetime.datetime) -> str:
        """Return the text."""
        if len(values[0]) > self.max_length:
            raise RefusedError(_("Use at most %(n)d characters.") % {"n": self.max_length})
        return values[0]

    def widget(self, question: Question, chosen: Sequence[str], viewing: Viewing) -> Widget:
        """Return an input of so many lines."""
        return Widget(
            "surveys/_entry.html" if self.lines == 1 else "surveys/_textarea.html",
            self.kind,
            value=first_choice(chosen),
            attributes={"maxlength": str(self.max_length)},
            more={"type": "text", "rows": self.lines},
            has_one_input=True,
        )
