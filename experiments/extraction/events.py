"""The events of sessions from all sources: task engine, server, robot and page."""

import statistics
from collections.abc import Iterable, Iterator
from typing import Any

from django.db.models import F, Min

from experiments.dataset.records import EventRecord
from experiments.extraction.allow_list import released
from experiments.extraction.forms import NEAR, Origin, Release
from experiments.extraction.sessions import granted
from experiments.models import Drive, TaskEvent
from experiments.stored_states import clock_offsets
from sessions.models import NetworkSample, SessionEvent


def events_of(drives: Iterable[Drive], release: Release) -> Iterator[EventRecord]:
    """Yield the events of each drive in order of time, by the server's clock."""
    for drive in drives:
        found = _of_drive(drive, release)
        yield from sorted(found, key=lambda event: (event.stamp, event.source, event.type))


def _of_drive(drive: Drive, release: Release) -> Iterator[EventRecord]:
    code, sources = release.names.session(drive.session_id), release.choice.sources
    origins = {source: origin_of(drive, source) for source in sources}
    for source, kind, stamp, received, data in _stored(drive, set(sources)):
        kept = released(source, kind, data, release, origins[source])
        if kept is not None:
            at = origins[source].relative(stamp)
            if abs(at) >= NEAR:  # the difference to a clock that was never set reveals the date
                at = Origin(granted(drive)).relative(received)
            yield EventRecord(code, at, source, kind, kept)


def _stored(drive: Drive, sources: set[str]) -> Iterator[tuple[str, str, float, float, Any]]:
    """Yield source, type, time by the sender's clock, time of receipt, and data of events."""
    if "task" in sources:
        tasks = TaskEvent.objects.filter(drive=drive).order_by("number")
        for kind, stamp, data in tasks.values_list("type", "stamp", "data"):
            yield "task", kind, stamp, stamp, data
    if others := sources - {"task"}:
        rows = SessionEvent.objects.filter(session=drive.session_id, source__in=others)
        values = rows.values_list("source", "type", "stamp", "received_at", "data")
        yield from values.order_by("received_at", "id").iterator(chunk_size=1000)


def origin_of(drive: Drive, source: str) -> Origin:
    """Return the zero of the times of a source's events."""
    offsets = {"robot": robot_offset, "page": page_offset}
    offset = offsets[source](drive.session_id) if source in offsets else 0.0
    return Origin(granted(drive), offset)


def robot_offset(session: object) -> float:
    """Return the median of the robot's clock minus the server's in seconds; 0 when unknown."""
    offsets = list(clock_offsets(session))
    return statistics.median(offsets) if offsets else 0.0


def page_offset(session: object) -> float:
    """Return the page's clock minus the server's in seconds, less the least transport time; 0
    without a message from the page.
    """
    late = Min(F("received_at") - F("stamp"))
    events = SessionEvent.objects.filter(session=session, source=SessionEvent.Source.PAGE)
    samples = NetworkSample.objects.filter(session=session)
    found = (rows.aggregate(least=late)["least"] for rows in (events, samples))
    return -min((least for least in found if least is not None), default=0.0)
