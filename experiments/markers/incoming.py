"""Markers of other streams, stored in the record of the sessions in progress at their time."""

from dataclasses import dataclass
from datetime import UTC, datetime

from django.db.models import Q

from experiments.models import Drive
from sessions.models import SessionEvent

MAX_TEXT = 500


@dataclass(frozen=True)
class ForeignMarker:
    """A sample of another stream at `at`, Unix seconds by the server's clock."""

    stream: str
    text: str
    at: float


def record(slug: str, marker: ForeignMarker, now: float) -> int:
    """Store a marker with each session of a study in progress then, and return their number."""
    at = datetime.fromtimestamp(marker.at, UTC)
    drives = Drive.objects.filter(
        Q(session__ended_at=None) | Q(session__ended_at__gte=at),
        participant__study__slug=slug,
        granted_at__lte=at,
    )
    data = {"stream": marker.stream, "value": marker.text[:MAX_TEXT].replace("\x00", "")}
    rows = [
        SessionEvent(
            session_id=session,
            source=SessionEvent.Source.LAB,
            type="marker",
            stamp=marker.at,
            received_at=now,
            data=data,
        )
        for session in drives.values_list("session", flat=True)
    ]
    SessionEvent.objects.bulk_create(rows)
    return len(rows)
