"""The events of sessions, from everybody who told of some: the task engine, the server, the robot
and the page.
"""

import statistics
from collections.abc import Iterable, Iterator

from django.db.models import F, Min

from experiments.analysis.dataset.records import EventRecord
from experiments.dataset.pseudonyms import Pseudonyms
from experiments.dataset.selection import Selection, event_data
from experiments.dataset.sessions import granted
from experiments.models import Drive, TaskEvent
from experiments.stored_states import clock_offsets
from sessions.models import NetworkSample, SessionEvent


def events_of(
    drives: Iterable[Drive], names: Pseudonyms, choice: Selection
) -> Iterator[EventRecord]:
    """Yield the events of drives, session by session and in order of time, by the
    server's clock.
    """
    for drive in drives:
        told = [*_task(drive, names, choice), *_told(drive, names, choice)]
        yield from sorted(told, key=lambda event: (event.stamp, event.source, event.type))


def _task(drive: Drive, names: Pseudonyms, choice: Selection) -> Iterator[EventRecord]:
    if "task" not in choice.sources:
        return
    code, begin = names.session(drive.session_id), granted(drive)
    for stamp, kind, data in (
        TaskEvent.objects.filter(drive=drive)
        .order_by("number")
        .values_list("stamp", "type", "data")
    ):
        yield EventRecord(
            code,
            round(stamp - begin, 6),
            "task",
            kind,
            event_data("task", kind, data, granted=begin, choice=choice, names=names),
        )


def _told(drive: Drive, names: Pseudonyms, choice: Selection) -> Iterator[EventRecord]:
    sources = [source for source in choice.sources if source != "task"]
    if not sources:
        return
    code, begin = names.session(drive.session_id), granted(drive)
    offsets = {"robot": robot_offset(drive.session_id), "page": page_offset(drive.session_id)}
    rows = SessionEvent.objects.filter(session=drive.session_id, source__in=sources).order_by(
        "received_at", "id"
    )
    for source, kind, stamp, data in rows.values_list("source", "type", "stamp", "data").iterator(
        chunk_size=1000
    ):
        kept = event_data(source, kind, data, granted=begin, choice=choice, names=names)
        yield EventRecord(
            code, round(stamp - offsets.get(source, 0.0) - begin, 6), source, kind, kept
        )


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
