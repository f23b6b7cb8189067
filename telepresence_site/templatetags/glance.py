"""What the administration's first page says before one clicks anything."""

import datetime
from dataclasses import dataclass

from django import template
from django.utils import timezone

from robots.models import Robot
from sessions.models import ManagerBeat, Session

MANAGER_SILENT_AFTER = datetime.timedelta(seconds=15)
register = template.Library()


@dataclass(frozen=True)
class Glance:
    """Five numbers and a question, from four small queries."""

    robots: int
    online: int
    driving: int
    waiting: int
    today: int
    manager_alive: bool


@register.simple_tag
def site_at_a_glance() -> Glance:
    """Return how the site is now."""
    now = timezone.now()
    robots = list(Robot.objects.filter(enabled=True).only("enabled", "connection", "last_seen_at"))
    states = list(
        Session.objects.exclude(state=Session.State.ENDED)
        .order_by()
        .values_list("state", flat=True)
    )
    waiting = states.count(Session.State.WAITING)
    midnight = timezone.localtime(now).replace(hour=0, minute=0, second=0, microsecond=0)
    return Glance(
        robots=len(robots),
        online=sum(robot.is_online(now) for robot in robots),
        driving=len(states) - waiting,
        waiting=waiting,
        today=Session.objects.filter(queued_at__gte=midnight).count(),
        manager_alive=ManagerBeat.objects.filter(beat_at__gte=now - MANAGER_SILENT_AFTER).exists(),
    )
