"""A number within bounds."""

import datetime
from collections.abc import Iterator, Sequence
from typing import Any, ClassVar, Literal

from django.utils.translation import gettext as _
from django.utils.translation import pgettext_lazy

from surveys.documents import Problem, Text, gettext_noop, spoken
from surveys.item import (
    EASTERNMOST,
    Item,
    Question,
    RefusedError,
    Scales,
    Viewing,
    Widget,
    day_at,
    first_choice,
    parsed_number,
    plain,
)


class Number(Item, frozen=True, kw_only=True, tag="number"):
    """A number within bounds; `this_year` is the year in which it is asked."""

    plain_name: ClassVar[Any] = pgettext_lazy("type of question", "Number")
    is_number: ClassVar[bool] = True

    minimum: float | None = None
    maximum: float | Literal["this_year"] | None = None
    whole: bool = False
    unit: Text = {}

    def own_texts(self) -> Iterator[Text]:
        """Yield the unit."""
        yield self.unit

    def problems(self, scales: Scales) -> Iterator[Problem]:
        """Yield that no number lies within the bounds."""
        if (
            isinstance(self.minimum, float)
            and isinstance(self.maximum, float)
            and self.minimum > self.maximum
        ):
            yield Problem(gettext_noop("The minimum is greater than the maximum."))

    def greatest(self, now: datetime.datetime) -> float | None:
        """Return the upper bound; None without one."""
        return day_at(now, EASTERNMOST).year if isinstance(self.maximum, str) else self.maximum

    def parse(
        self, question: Question, values: Sequence[str], now: datetime.datetime
    ) -> int | float:
        """Return the number, as an int where it has to be whole."""
        number = parsed_number(values[0])
        if self.whole and number != int(number):
            raise RefusedError(_("Enter a whole number."))
        least, greatest = self.minimum, self.greatest(now)
        if least is not None and number < least:
            raise RefusedError(_("Enter a number of at least %(n)s.") % {"n": plain(least)})
        if greatest is not None and number > greatest:
            raise RefusedError(_("Enter a number of at most %(n)s.") % {"n": plain(greatest)})
        return int(number) if self.whole else number

    def sent(self, value: Any) -> list[str]:
        """Return the number without needless decimals."""
        return [plain(value)]

    def widget(self, question: Question, chosen: Sequence[str], viewing: Viewing) -> Widget:
        """Return an input for a number, and its unit."""
        bounds = {"min": self.minimum, "max": self.greatest(viewing.now)}
        return Widget(
            "surveys/_entry.html",
            self.kind,
            value=first_choice(chosen),
            attributes={
                "step": "1" if self.whole else "any",
                "inputmode": "numeric" if self.whole else "decimal",
                **{name: plain(bound) for name, bound in bounds.items() if bound is not None},
            },
            more={"type": "number", "unit": spoken(self.unit, viewing.language)},
            has_one_input=True,
        )
