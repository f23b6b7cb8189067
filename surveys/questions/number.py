"""A number within bounds; `this_year` is the year in which it is asked."""

import datetime
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, ClassVar, Literal

from django.utils.translation import gettext as _, gettext_lazy, pgettext_lazy

from surveys import item
from surveys.documents import Problem, Text, gettext_noop, spoken
from surveys.item import Item, Question, RefusedError, Scales, Viewing, Widget, plain


class Number(Item, frozen=True, kw_only=True, tag="number"):
    plain_name: ClassVar[Any] = pgettext_lazy("type of question", "Number")
    labels: ClassVar[Mapping[str, Any]] = {
        "minimum": gettext_lazy("Minimum"),
        "maximum": gettext_lazy("Maximum"),
        "whole": gettext_lazy("Whole numbers only"),
        "unit": gettext_lazy("Unit"),
    }
    hints: ClassVar[Mapping[str, Any]] = {
        "maximum": gettext_lazy("Write this_year for the year of the answer.")
    }
    is_number: ClassVar[bool] = True

    minimum: float | None = None
    maximum: float | Literal["this_year"] | None = None
    whole: bool = False
    unit: Text = {}

    def problems(self, scales: Scales) -> Iterator[Problem]:
        least, greatest = self.minimum, self.maximum
        if isinstance(least, float) and isinstance(greatest, float) and least > greatest:
            yield Problem(gettext_noop("The minimum is greater than the maximum."))

    def greatest(self, now: datetime.datetime) -> float | None:
        year = item.day_at(now, item.EASTERNMOST).year
        return year if isinstance(self.maximum, str) else self.maximum

    def parse(self, question: Question, values: Sequence[str], now: datetime.datetime) -> float:
        number = item.parsed_number(values[0])
        if self.whole and number != int(number):
            raise RefusedError(_("Enter a whole number."))
        least, greatest = self.minimum, self.greatest(now)
        if least is not None and number < least:
            raise RefusedError(_("Enter a number of at least %(n)s.") % {"n": plain(least)})
        if greatest is not None and number > greatest:
            raise RefusedError(_("Enter a number of at most %(n)s.") % {"n": plain(greatest)})
        return int(number) if self.whole else number

    def widget(self, question: Question, chosen: Sequence[str], viewing: Viewing) -> Widget:
        bounds = {"min": self.minimum, "max": self.greatest(viewing.now)}
        step, mode = ("1", "numeric") if self.whole else ("any", "decimal")
        given = {name: plain(bound) for name, bound in bounds.items() if bound is not None}
        attributes = {"step": step, "inputmode": mode, **given}
        unit = spoken(self.unit, viewing.language)
        return self.entry(chosen, attributes, type="number", unit=unit)
