"""Where a visitor who waits can practise: which of the simulated robots that are there for it
(telepresence_site/practice runs them).
"""

import datetime
from dataclasses import dataclass

from django.contrib.auth.decorators import login_required
from django.db.models import Count, Q
from django.http import HttpRequest, JsonResponse
from django.urls import reverse
from django.utils import timezone
from django.views.decorators.cache import never_cache
from django.views.decorators.http import require_safe

from robots.models import Robot
from sessions.leases.store import LIVE


@dataclass(frozen=True)
class Place:
    """A practice robot: whether it could be driven now, and how many drive it or wait for it."""

    name: str
    there: bool
    taken: int


def choose(places: list[Place]) -> str | None:
    """Return the robot at which the visitor's turn comes first; None while none is there yet."""
    there = [place for place in places if place.there]
    return min(there, key=lambda place: (place.taken, place.name)).name if there else None


def places(now: datetime.datetime) -> list[Place]:
    """Return all practice robots in use."""
    living = Count("sessions", filter=Q(sessions__state__in=LIVE))
    rows = Robot.objects.filter(practice=True, enabled=True).annotate(taken=living).order_by("name")
    return [Place(row.name, row.is_online(now), row.taken) for row in rows]


@never_cache
@login_required
@require_safe
def practice(_request: HttpRequest) -> JsonResponse:
    """Say where to practise: `url` of a drive page, null while a robot is being made ready, which
    takes some seconds.
    """
    chosen = choose(places(timezone.now()))
    return JsonResponse(
        {"url": None if chosen is None else f"{reverse('practice_drive', args=[chosen])}?go=1"}
    )
