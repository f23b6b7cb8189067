"""The markers of a study: its events, each once, with the contents and codes that they have in a
pseudonymous dataset.

A marker's time is that of the replay and of datasets: the server's clock, for which the clocks of
robot and page are corrected. Events are stored a moment after they happened, so a marker is
published late, with the time of the event.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import msgspec
from django.db.models import Q

from experiments.coding import store
from experiments.extraction.allow_list import coded, released
from experiments.extraction.build import release_of
from experiments.extraction.events import origin_of
from experiments.extraction.forms import Origin, Release, kept
from experiments.extraction.selection import Selection
from experiments.models import Coding, CodingSchemeVersion, Drive, StepVisit, Study, TaskEvent
from sessions.models import SessionEvent

LATE_S = 60.0  # an event is stored within this time, also when a robot sends it again
LAB = "lab"  # the source of the markers of other streams, which are not sent back to them


class Marker(msgspec.Struct, frozen=True, omit_defaults=True):
    """A sample of our stream, sent as JSON. `t` is in seconds since the grant of the robot, absent
    without a session; `data` depends on the type as in the events of a dataset.
    """

    type: str
    source: str
    session: str = ""
    participant: str = ""
    t: float | None = None
    data: dict[str, Any] = {}

    def text(self) -> str:
        return msgspec.json.encode(self).decode()


@dataclass(frozen=True)
class TimedMarker:
    """A marker at `at`, Unix seconds by the server's clock; `key` identifies it."""

    key: tuple[Any, ...]
    at: float
    marker: Marker


class MarkerSource:
    """The events of a study since `since` (Unix seconds), from the database."""

    def __init__(self, slug: str, since: float) -> None:
        self._slug, self._since = slug, since
        self._published: set[tuple[Any, ...]] = set()
        self._releases: dict[Any, Release] = {}

    def new(self, now: float) -> list[TimedMarker]:
        """Return the markers that were not returned before, in order of time."""
        begin = max(self._since, now - LATE_S)
        found = [
            one
            for one in (*self._of_drives(begin), *self._of_steps(begin), *self._of_codings())
            if one.key not in self._published
        ]
        self._published |= {one.key for one in found}
        return sorted(found, key=lambda one: one.at)

    def _release(self, study: Study) -> Release:
        if study.pk not in self._releases:
            self._releases[study.pk] = release_of(study, Selection())
        return self._releases[study.pk]

    def _of_drives(self, begin: float) -> Iterator[TimedMarker]:
        """Yield the events of drives that are in progress, or ended a moment ago."""
        recent = Q(session__ended_at=None) | Q(session__ended_at__gte=_at(begin))
        drives = Drive.objects.filter(recent, participant__study__slug=self._slug)
        for drive in drives.select_related("participant__study", "session"):
            yield from self._of_drive(drive, begin)

    def _of_drive(self, drive: Drive, begin: float) -> Iterator[TimedMarker]:
        rows = SessionEvent.objects.filter(session=drive.session_id, received_at__gte=begin)
        tasks = TaskEvent.objects.filter(drive=drive, stamp__gte=begin)
        events: list[tuple[str, Any, SessionEvent | TaskEvent]] = [
            *((row.source, row.pk, row) for row in rows.exclude(source=LAB)),
            *(("task", (drive.pk, task.number, task.type), task) for task in tasks),
        ]
        origins = {source: origin_of(drive, source) for source in {one for one, *_ in events}}
        release = self._release(drive.participant.study)
        session = release.names.session(drive.session_id)
        for source, key, event in events:
            origin = origins[source]
            data = released(source, event.type, event.data, release, origin)
            if data is not None:
                t, code = origin.relative(event.stamp), drive.participant.code
                marker = Marker(event.type, source, session, participant=code, t=t, data=data)
                yield TimedMarker((source, key), event.stamp - origin.offset, marker)

    def _of_steps(self, begin: float) -> Iterator[TimedMarker]:
        """Yield a marker for each display of a questionnaire to a participant."""
        own = {"participant__study__slug": self._slug, "began_at__gte": _at(begin)}
        for row in StepVisit.objects.filter(**own).select_related("participant__study"):
            asking = row.participant.study.as_definition().questionnaire_steps
            if row.step in {step.key for step in asking}:
                data = {"step": row.step, "visit": row.visit, "round": row.round}
                code = row.participant.code
                marker = Marker("questionnaire_shown", "study", participant=code, data=data)
                yield TimedMarker(("step", row.pk), row.began_at.timestamp(), marker)

    def _of_codings(self) -> Iterator[TimedMarker]:
        """Yield the events of codings that were finished since, of sessions that are released."""
        fresh = Coding.objects.filter(
            scheme__study__slug=self._slug, done_at__gte=_at(self._since)
        ).values_list("scheme", flat=True)
        for scheme in CodingSchemeVersion.objects.filter(pk__in=set(fresh)).select_related("study"):
            for coding in store.released(scheme):
                if ("coding", coding.pk) not in self._published:
                    self._published.add(("coding", coding.pk))
                    yield from self._of_coding(scheme, coding)

    def _of_coding(self, scheme: CodingSchemeVersion, coding: Coding) -> Iterator[TimedMarker]:
        release, listed = self._release(scheme.study), coded(store.read_scheme(scheme))
        begin = (coding.session.granted_at or coding.session.queued_at).timestamp()
        session = release.names.session(coding.session_id)
        for number, event in enumerate(store.events_of(coding)):
            left = kept(listed, msgspec.structs.asdict(event), release, Origin(0.0))
            data = {"coder": f"C{coding.number}"} | left
            marker = Marker("coded", "coder", session, t=event.begin, data=data)
            yield TimedMarker(("coded", coding.pk, number), begin + event.begin, marker)


def _at(stamp: float) -> datetime:
    return datetime.fromtimestamp(stamp, UTC)
