"""The events of sessions from all of their sources: the task engine, the server, the robot and the
page.
"""

import statistics
from collections.abc import Iterable, Iterator

from django.db.models import F, Min

from experiments.dataset.records import EventRecord
from experiments.extraction.allow_list import released
from experiments.extraction.forms import NEAR, Origin, Release
from experiments.extraction.sessions import granted
from experiments.models import Drive, TaskEvent
from experiments.stored_states import clock_offsets
from sessions.models import NetworkSample, SessionEvent


def events_of(drives: Iterable[Drive], release: Release) -> Iterator[EventRecord]:
    """Yield the events of drives, session by session and in order of time, by the server's
    clock.
    """
    for drive in drives:
        found = [*_of_task(drive, release), *_of_session(drive, release)]
        yield from sorted(found, key=lambda event: (event.stamp, event.source, event.type))


def _of_task(drive: Drive, release: Release) -> Iterator[EventRecord]:
    if "task" not in release.choice.sources:
        return
    code, origin = release.names.session(drive.session_id), Origin(granted(drive))
    rows = TaskEvent.objects.filter(drive=drive).order_by("number")
    for stamp, kind, data in rows.values_list("stamp", "type", "data"):
        kept = released("task", kind, data, release, origin)
        if kept is not None:
            yield EventRecord(code, origin.relative(stamp), "task", kind, kept)


def _of_session(drive: Drive, release: Release) -> Iterator[EventRecord]:
    sources = [source for source in release.choice.sources if source != "task"]
    if not sources:
        return
    code, begin = release.names.session(drive.session_id), granted(drive)
    origins = {
        "robot": Origin(begin, robot_offset(drive.session_id)),
        "page": Origin(begin, page_offset(drive.session_id)),
    }
    rows = SessionEvent.objects.filter(session=drive.session_id, source__in=sources)
    for row in rows.order_by("received_at", "id").iterator(chunk_size=1000):
        origin = origins.get(row.source, Origin(begin))
        kept = released(row.source, row.type, row.data, release, origin)
        if kept is None:
            continue
        at = origin.relative(row.stamp)
        if abs(at) >= NEAR:  # the difference to a clock that was never set would reveal the date
            at = round(row.received_at - begin, 6)
        yield EventRecord(code, at, row.source, row.type, kept)


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
