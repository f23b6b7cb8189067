"""Opening hours as text: a line for each day of the week, and one sentence for all of them."""

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any
from zoneinfo import available_timezones

from django import forms
from django.utils.dates import WEEKDAYS
from django.utils.translation import gettext, gettext_lazy as _

from experiments.definition import opening_hours
from experiments.participation.landing import days_in_words
from surveys.document_forms.problem_text import sentences

Hours = list[dict[str, Any]]
DAYS = tuple(f"day_{n}" for n in range(7))
_SPAN = re.compile(r"(\d{1,2}):?(\d{2})?\s*(?:-|–|to|a)\s*(\d{1,2}):?(\d{2})?\Z", re.ASCII)


def lines_by_day(hours: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """Return the line of each field of DAYS: "09:00-13:00, 15:00-17:00", empty when closed."""
    spans = sorted((span["start"], span["end"], day) for span in hours for day in span["days"])
    return {
        name: ", ".join(f"{start}-{end}" for start, end, day in spans if day == number)
        for number, name in enumerate(DAYS)
    }


def from_days(lines: Iterable[str]) -> Hours:
    """Return hours from lines for each day from Monday. ValueError has the text that is no span."""
    days: dict[tuple[str, str], list[int]] = {}
    for number, text in enumerate(lines):
        for part in filter(None, (part.strip() for part in text.split(","))):
            days.setdefault(_span(part), []).append(number)
    return [
        {"days": sorted(set(numbers)), "start": start, "end": end}
        for (start, end), numbers in days.items()
    ]


def _span(text: str) -> tuple[str, str]:
    found = _SPAN.fullmatch(text)
    if found is None:
        raise ValueError(text)
    start, start_minutes, end, end_minutes = found.groups()
    # 24:00 is how people write the end of a day.
    return (
        f"{int(start):02d}:{start_minutes or '00'}",
        f"{int(end) % 24 if end == '24' else int(end):02d}:{end_minutes or '00'}",
    )


def summary(hours: Sequence[Mapping[str, Any]], time_zone: str) -> str:
    """Return opening hours in one line: "Mon-Fri 09:00-17:00 (Europe/Madrid)"."""
    if not hours:
        return gettext("always open")
    spans = (f"{days_in_words(one['days'], '-')} {one['start']}-{one['end']}" for one in hours)
    return f"{'; '.join(spans)} ({time_zone})"


class HoursForm(forms.Form):
    """A line for each day of the week; all empty: always open. A valid form has `hours`."""

    hours: Hours
    time_zone = forms.ChoiceField(
        label=_("Time zone"),
        choices=lambda: [(name, name) for name in sorted(available_timezones())],
    )

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        for number, name in enumerate(DAYS):
            wide = forms.TextInput(attrs={"class": "vTextField"})
            self.fields[name] = forms.CharField(
                label=WEEKDAYS[number], required=False, max_length=200, widget=wide
            )

    def clean(self) -> None:
        lines = [self.cleaned_data.get(name, "") for name in DAYS]
        for name, line in zip(DAYS, lines, strict=True):
            try:
                from_days([line])
            except ValueError as error:
                text = gettext("“%(text)s” is not a time range such as 09:00-17:00.")
                self.add_error(name, text % {"text": error})
        if not self.errors:
            self.hours = from_days(lines)
            zone = self.cleaned_data["time_zone"]
            for problem in sentences(opening_hours.problems(self.hours, zone)):
                self.add_error(None, problem)
