"""A day within bounds."""

import datetime
from collections.abc import Iterator, Sequence
from typing import Annotated, Any, ClassVar

import msgspec
from django.utils.translation import gettext as _
from django.utils.translation import gettext_lazy

from surveys.documents import Problem, gettext_noop
from surveys.item import (
    EASTERNMOST,
    WESTERNMOST,
    Item,
    Question,
    RefusedError,
    Scales,
    Viewing,
    Widget,
    day_at,
    first_choice,
)

Day = Annotated[str, msgspec.Meta(pattern=r"^(today|\d{4}-\d{2}-\d{2})$")]


class Date(Item, frozen=True, kw_only=True, tag="date"):
    """A day within bounds, stored as year-month-day."""

    plain_name: ClassVar[Any] = gettext_lazy("Date")

    earliest: Day | None = None
    latest: Day | None = None

    def problems(self, scales: Scales) -> Iterator[Problem]:
        """Yield that a bound is no day, or that no day lies within them."""
        days = []
        for day in (self.earliest, self.latest):
            try:
                days += [datetime.date.fromisoformat(day)] if day not in {None, "today"} else []
            except ValueError:
                words = gettext_noop("Write a day as year-month-day, or today.")
                yield Problem(words, names=((day,),))
        if len(days) == len((self.earliest, self.latest)) and days[0] > days[1]:
            yield Problem(gettext_noop("The earliest day is after the latest day."))

    def days_between(
        self, now: datetime.datetime
    ) -> tuple[datetime.date | None, datetime.date | None]:
        """Return the earliest and the latest day that it may be; None without a bound. Somewhere on
        Earth it is still, or already, today.
        """
        return (
            _bound(self.earliest, day_at(now, WESTERNMOST)),
            _bound(self.latest, day_at(now, EASTERNMOST)),
        )

    def parse(self, question: Question, values: Sequence[str], now: datetime.datetime) -> str:
        """Return the day as year-month-day."""
        try:
            day = datetime.date.fromisoformat(values[0])
        except ValueError as error:
            raise RefusedError(_("Enter the date as year-month-day.")) from error
        earliest, latest = self.days_between(now)
        if earliest is not None and day < earliest:
            raise RefusedError(_("The earliest date is %(day)s.") % {"day": earliest.isoformat()})
        if latest is not None and day > latest:
            raise RefusedError(_("The latest date is %(day)s.") % {"day": latest.isoformat()})
        return day.isoformat()

    def widget(self, question: Question, chosen: Sequence[str], viewing: Viewing) -> Widget:
        """Return an input for a day."""
        days = dict(zip(("min", "max"), self.days_between(viewing.now), strict=True))
        return Widget(
            "surveys/_entry.html",
            self.kind,
            value=first_choice(chosen),
            attributes={name: day.isoformat() for name, day in days.items() if day is not None},
            more={"type": "date"},
            has_one_input=True,
        )


def _bound(bound: str | None, today: datetime.date) -> datetime.date | None:
    if bound is None or bound == "today":
        return None if bound is None else today
    return datetime.date.fromisoformat(bound)
