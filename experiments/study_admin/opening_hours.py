"""Opening hours as people write them: a line for each day of the week, and one sentence for all of
them.
"""

import re
from collections.abc import Mapping, Sequence
from typing import Any
from zoneinfo import available_timezones

from django import forms
from django.utils.dates import WEEKDAYS, WEEKDAYS_ABBR
from django.utils.translation import gettext
from django.utils.translation import gettext_lazy as _

from experiments.definition import opening_hours
from surveys.document_forms.problem_text import sentences

Hours = list[dict[str, Any]]
DAYS = tuple(f"day_{n}" for n in range(7))
_SPAN = re.compile(r"(\d{1,2}):?(\d{2})?\s*(?:-|–|to|a)\s*(\d{1,2}):?(\d{2})?\Z", re.ASCII)


def told_by_day(hours: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return what is written for Monday to Sunday: "09:00-13:00, 15:00-17:00", empty for a closed
    day.
    """
    spans = sorted((span["start"], span["end"], day) for span in hours for day in span["days"])
    return [
        ", ".join(f"{start}-{end}" for start, end, day in spans if day == number)
        for number in range(7)
    ]


def from_days(written: Sequence[str]) -> Hours:
    """Return opening hours from what is written for Monday to Sunday; days with the same span stand
    together.

    Raises:
        ValueError: with the words that are no span.
    """
    days: dict[tuple[str, str], list[int]] = {}
    for number, text in enumerate(written):
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
    spans = "; ".join(f"{_days(span['days'])} {span['start']}-{span['end']}" for span in hours)
    return f"{spans} ({time_zone})"


def _days(days: Sequence[int]) -> str:
    runs: list[list[int]] = []
    for day in sorted(set(days)):
        if runs and day == runs[-1][-1] + 1:
            runs[-1].append(day)
        else:
            runs.append([day])
    return ", ".join(
        str(WEEKDAYS_ABBR[run[0]]) + (f"-{WEEKDAYS_ABBR[run[-1]]}" if len(run) > 1 else "")
        for run in runs
    )


class HoursForm(forms.Form):
    """A line for each day of the week; all empty means always open."""

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
        self.hours: Hours = []

    def clean(self) -> dict[str, Any]:
        """Read the days; each that cannot be read is told at its field."""
        cleaned = super().clean() or self.cleaned_data
        for name in DAYS:
            try:
                from_days([cleaned.get(name, "")])
            except ValueError as error:
                self.add_error(
                    name,
                    gettext("“%(text)s” is not a time range such as 09:00-17:00.")
                    % {"text": error},
                )
        if self.errors:
            return cleaned
        self.hours = from_days([cleaned.get(name, "") for name in DAYS])
        for problem in sentences(opening_hours.problems(self.hours, cleaned["time_zone"])):
            self.add_error(None, problem)
        return cleaned
