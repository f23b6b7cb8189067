"""The markers of a study: its events, each once, with what a pseudonymous dataset has of them and
under the same codes.

A marker's time is that of the replay and of datasets: the server's clock, for which the clocks of
robot and page are corrected. Events are stored a moment after they happened, so a marker is
published late, with the time of the event.
"""

from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Any

import msgspec
from django.db.models import Q

from experiments.coding import store
from experiments.extraction.allow_list import coded, released
from experiments.extraction.build import release_of
from experiments.extraction.events import page_offset, robot_offset
from experiments.extraction.forms import Origin, Release, kept
from experiments.extraction.selection import Selection
from experiments.markers.marker import Marker, TimedMarker
from experiments.models import Coding, CodingSchemeVersion, Drive, StepVisit, Study, TaskEvent
from sessions.models import SessionEvent

LATE_S = 60.0  # an event is stored within this time, also when a robot sends it again
LAB = "lab"  # the source of the markers of other streams, which are not sent back to them


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
        """Yield the events of drives that go on, or ended a moment ago."""
        recent = Q(session__ended_at=None) | Q(session__ended_at__gte=_at(begin))
        drives = Drive.objects.filter(recent, participant__study__slug=self._slug)
        for drive in drives.select_related("participant__study", "session"):
            yield from self._of_drive(drive, begin)

    def _of_drive(self, drive: Drive, begin: float) -> Iterator[TimedMarker]:
        session, granted = drive.session_id, drive.granted_at.timestamp()
        rows = SessionEvent.objects.filter(session=session, received_at__gte=begin)
        events = list(rows.exclude(source=LAB))
        origins = {source: Origin(granted) for source in {row.source for row in events} | {"task"}}
        for source, offset in (("robot", robot_offset), ("page", page_offset)):
            if source in origins:
                origins[source] = Origin(granted, offset(session))
        for row in events:
            event = (row.source, row.type, row.stamp, row.data)
            yield from self._event(drive, row.pk, origins[row.source], event)
        for task in TaskEvent.objects.filter(drive=drive, stamp__gte=begin):
            key = (drive.pk, task.number, task.type)
            event = ("task", task.type, task.stamp, task.data)
            yield from self._event(drive, key, origins["task"], event)

    def _event(
        self, drive: Drive, key: Any, origin: Origin, event: tuple[str, str, float, dict[str, Any]]
    ) -> Iterator[TimedMarker]:
        source, kind, stamp, data = event
        release = self._release(drive.participant.study)
        left = released(source, kind, data, release, origin)
        if left is not None:
            marker = Marker(
                type=kind,
                source=source,
                session=release.names.session(drive.session_id),
                participant=drive.participant.code,
                t=origin.relative(stamp),
                data=left,
            )
            yield TimedMarker((source, key), stamp - origin.offset, marker)

    def _of_steps(self, begin: float) -> Iterator[TimedMarker]:
        """Yield which questionnaire was shown to whom."""
        rows = StepVisit.objects.filter(
            participant__study__slug=self._slug, began_at__gte=_at(begin)
        )
        for row in rows.select_related("participant__study"):
            if row.step in {step.key for step in row.participant.study.as_definition().asking}:
                marker = Marker(
                    type="questionnaire_shown",
                    source="study",
                    participant=row.participant.code,
                    data={"step": row.step, "visit": row.visit, "round": row.round},
                )
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
        for number, event in enumerate(store.events_of(coding)):
            left = kept(listed, msgspec.structs.asdict(event), release, Origin(0.0))
            marker = Marker(
                type="coded",
                source="coder",
                session=release.names.session(coding.session_id),
                t=event.begin,
                data={"coder": f"C{coding.number}"} | left,
            )
            yield TimedMarker(("coded", coding.pk, number), begin + event.begin, marker)


def _at(stamp: float) -> datetime:
    return datetime.fromtimestamp(stamp, UTC)
