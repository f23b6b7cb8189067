"""Free text on one line or several."""

import datetime
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, ClassVar

import msgspec
from django.utils.translation import gettext as _, gettext_lazy

from surveys.item import Item, Question, RefusedError, Viewing, Widget


class TextItem(Item, frozen=True, kw_only=True, tag="text"):
    plain_name: ClassVar[Any] = gettext_lazy("Free text")
    labels: ClassVar[Mapping[str, Any]] = {
        "lines": gettext_lazy("Lines"),
        "max_length": gettext_lazy("Maximum number of characters"),
    }
    is_free_text: ClassVar[bool] = True

    lines: Annotated[int, msgspec.Meta(ge=1, le=20)] = 1
    max_length: Annotated[int, msgspec.Meta(ge=1, le=5000)] = 1000

    def parse(self, question: Question, values: Sequence[str], now: datetime.datetime) -> str:
        if len(values[0]) > self.max_length:
            raise RefusedError(_("Use at most %(n)d characters.") % {"n": self.max_length})
        return values[0]

    def widget(self, question: Question, chosen: Sequence[str], viewing: Viewing) -> Widget:
        template = "surveys/_entry.html" if self.lines == 1 else "surveys/_textarea.html"
        attributes = {"maxlength": self.max_length}
        return self.entry(chosen, attributes, template, type="text", rows=self.lines)
