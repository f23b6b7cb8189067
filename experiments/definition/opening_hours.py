"""When a study is open: spans of the week in its own time zone; no span means always.

A span is `{"days": [0..6], "start": "09:00", "end": "17:00"}`, Monday is 0. A span that does not
end later than it starts ends on the next day: `00:00` to `00:00` is a whole day. These are
wall-clock times, also across a change of the clocks; a time that the clocks skip counts as the
moment that the clock before the change would show.
"""

import datetime
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

from surveys.documents import Problem, gettext_noop as _, within

Hours = Sequence[Mapping[str, Any]]
_CLOCK = re.compile(r"(?:[01]\d|2[0-3]):[0-5]\d\Z", re.ASCII)
_MOST_SPANS = 50
_WEEK = 7


def problems(hours: Any, time_zone: str) -> Iterator[Problem]:
    """Yield the problems of opening hours from a form or file."""
    try:
        ZoneInfo(time_zone)
    except (ZoneInfoNotFoundError, ValueError, OSError):  # also for folders and bad paths
        words = _("There is no time zone “%(name)s”; use a name such as Europe/Madrid.")
        yield Problem(words, {"name": time_zone})
    if not isinstance(hours, list) or len(hours) > _MOST_SPANS:
        yield Problem(_("Opening hours must be a list of at most %(n)d spans."), {"n": _MOST_SPANS})
        return
    for number, span in enumerate(hours, start=1):
        yield from within(_of_span(span), None, _("Span"), number)


def _of_span(span: Any) -> Iterator[Problem]:
    if not isinstance(span, dict) or set(span) != {"days", "start", "end"}:
        yield Problem(_("it needs exactly days, start and end."))
        return
    days = span["days"]
    are_days = isinstance(days, list) and all(type(one) is int and 0 <= one < _WEEK for one in days)
    if not days or not are_days:
        yield Problem(_("its days must be one or more numbers from 0 (Monday) to 6."))
    for name in ("start", "end"):
        if not isinstance(span[name], str) or not _CLOCK.match(span[name]):
            yield Problem(_("%(name)s must be a time such as 09:00."), {"name": name})


def is_open(hours: Hours, time_zone: str, now: datetime.datetime) -> bool:
    return not hours or any(start <= now < end for start, end in spans(hours, time_zone, now))


def opens_at(hours: Hours, time_zone: str, now: datetime.datetime) -> datetime.datetime | None:
    """Return when a closed study opens next, in its own time zone; None when it is open."""
    if is_open(hours, time_zone, now):
        return None
    later = min(start for start, _end in spans(hours, time_zone, now) if start > now)
    return later.astimezone(ZoneInfo(time_zone))


def opens_on_the_wall(hours: Hours, zone: str, now: datetime.datetime) -> datetime.datetime | None:
    """Return `opens_at` as naive wall-clock time there, which templates do not convert."""
    later = opens_at(hours, zone, now)
    return later.replace(tzinfo=None) if later is not None else None


def spans(
    hours: Hours, time_zone: str, now: datetime.datetime, days_ahead: int = _WEEK + 1
) -> list[tuple[datetime.datetime, datetime.datetime]]:
    """Return the spans from the day before a moment to `days_ahead` days after it, in UTC."""
    zone = ZoneInfo(time_zone)
    today = now.astimezone(zone).date()
    days = [today + datetime.timedelta(days=shift) for shift in range(-1, days_ahead + 1)]
    each = ((day, span) for day in days for span in hours if day.weekday() in span["days"])
    return [_moments(span, day, zone) for day, span in each]


def _moments(
    span: Mapping[str, Any], day: datetime.date, zone: ZoneInfo
) -> tuple[datetime.datetime, datetime.datetime]:
    start, end = (datetime.time.fromisoformat(span[name]) for name in ("start", "end"))
    last = day if end > start else day + datetime.timedelta(days=1)
    opens = datetime.datetime.combine(day, start, zone)
    closes = datetime.datetime.combine(last, end, zone)
    # In UTC: moments of one zone compare by the wall clock, which is wrong when the clocks change.
    return opens.astimezone(datetime.UTC), closes.astimezone(datetime.UTC)
