"""Markers of other streams, stored in the record of the sessions in progress at their time."""

from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

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
    living = Q(session__ended_at=None) | Q(session__ended_at__gte=at)
    drives = Drive.objects.filter(living, participant__study__slug=slug, granted_at__lte=at)
    data = {"stream": marker.stream, "value": marker.text[:MAX_TEXT].replace("\x00", "")}
    fields: dict[str, Any] = {"source": SessionEvent.Source.LAB, "type": "marker", "data": data}
    rows = [
        SessionEvent(session_id=session, stamp=marker.at, received_at=now, **fields)
        for session in drives.values_list("session", flat=True)
    ]
    SessionEvent.objects.bulk_create(rows)
    return len(rows)
