"""The events of sessions, from everybody who told of some: the task engine, the server, the robot
and the page.
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
    """Yield the events of drives, session by session and in order of time, by the
    server's clock.
    """
    for drive in drives:
        told = [*_task(drive, release), *_told(drive, release)]
        yield from sorted(told, key=lambda event: (event.stamp, event.source, event.type))


def _task(drive: Drive, release: Release) -> Iterator[EventRecord]:
    if "task" not in release.choice.sources:
        return
    code, origin = release.names.session(drive.session_id), Origin(granted(drive))
    for stamp, kind, data in (
        TaskEvent.objects.filter(drive=drive)
        .order_by("number")
        .values_list("stamp", "type", "data")
    ):
        kept = released("task", kind, data, release, origin)
        if kept is not None:
            yield EventRecord(code, origin.relative(stamp), "task", kind, kept)


def _told(drive: Drive, release: Release) -> Iterator[EventRecord]:
    sources = [source for source in release.choice.sources if source != "task"]
    if not sources:
        return
    code, begin = release.names.session(drive.session_id), granted(drive)
    origins = {
        "robot": Origin(begin, robot_offset(drive.session_id)),
        "page": Origin(begin, page_offset(drive.session_id)),
    }
    rows = SessionEvent.objects.filter(session=drive.session_id, source__in=sources).order_by(
        "received_at", "id"
    )
    columns = ("source", "type", "stamp", "received_at", "data")
    for source, kind, stamp, received, data in rows.values_list(*columns).iterator(chunk_size=1000):
        origin = origins.get(source, Origin(begin))
        kept = released(source, kind, data, release, origin)
        if kept is not None:
            yield EventRecord(code, _at(stamp, received, origin), source, kind, kept)


def _at(stamp: float, received: float, origin: Origin) -> float:
    """Return when an event happened; when it was received where the sender's clock was not set: the
    difference to such a clock would tell the date.
    """
    relative = origin.relative(stamp)
    return relative if abs(relative) < NEAR else round(received - origin.granted, 6)


def robot_offset(session: object) -> float:
    """Return the robot's clock minus the server's in seconds, as it mostly was; 0 when it was never
    known.
    """
    offsets = list(clock_offsets(session))
    return statistics.median(offsets) if offsets else 0.0


def page_offset(session: object) -> float:
    """Return the page's clock minus the server's in seconds, less the least time on the way; 0
    without a word of it.
    """
    late = F("received_at") - F("stamp")
    events = SessionEvent.objects.filter(
        session=session, source=SessionEvent.Source.PAGE
    ).aggregate(least=Min(late))["least"]
    samples = NetworkSample.objects.filter(session=session).aggregate(least=Min(late))["least"]
    known = [least for least in (events, samples) if least is not None]
    return -min(known) if known else 0.0
