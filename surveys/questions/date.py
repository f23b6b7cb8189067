"""A day within bounds, stored as year-month-day."""

import datetime
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, ClassVar

import msgspec
from django.utils.translation import gettext as _, gettext_lazy

from surveys import item
from surveys.documents import Problem, gettext_noop
from surveys.item import Item, Question, RefusedError, Scales, Viewing, Widget

Day = Annotated[str, msgspec.Meta(pattern=r"^(today|\d{4}-\d{2}-\d{2})$")]


class Date(Item, frozen=True, kw_only=True, tag="date"):
    plain_name: ClassVar[Any] = gettext_lazy("Date")
    labels: ClassVar[Mapping[str, Any]] = {
        "earliest": gettext_lazy("Earliest day"),
        "latest": gettext_lazy("Latest day"),
    }
    hints: ClassVar[Mapping[str, Any]] = dict.fromkeys(
        labels, gettext_lazy("As year-month-day, such as 2020-12-31, or today.")
    )

    earliest: Day | None = None
    latest: Day | None = None

    def problems(self, scales: Scales) -> Iterator[Problem]:
        days = []
        for day in (self.earliest, self.latest):
            try:
                days += [datetime.date.fromisoformat(day)] if day not in {None, "today"} else []
            except ValueError:
                words = gettext_noop("Write a day as year-month-day, or today.")
                yield Problem(words, names=((day,),))
        if len(days) == len((self.earliest, self.latest)) and days[0] > days[1]:
            yield Problem(gettext_noop("The earliest day is after the latest day."))

    def days_between(self, now: datetime.datetime) -> list[datetime.date | None]:
        """Return the earliest and the latest allowed day; None without a bound. "today" is any day
        that it is now somewhere on Earth.
        """
        bounds = ((self.earliest, item.WESTERNMOST), (self.latest, item.EASTERNMOST))
        days = [str(item.day_at(now, at)) if day == "today" else day for day, at in bounds]
        return [datetime.date.fromisoformat(day) if day else None for day in days]

    def parse(self, question: Question, values: Sequence[str], now: datetime.datetime) -> str:
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
        earliest, latest = self.days_between(viewing.now)
        return self.entry(chosen, {"min": earliest, "max": latest}, type="date")
