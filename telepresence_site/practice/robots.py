"""The rows of the practice robots, and the demand for them."""

import datetime

from django.conf import settings
from django.db.models import Max

from robots.models import FloorPlan, Robot
from robots.plans.floorplans import store_floor_plan
from sessions.leases.policy import PAGE_GONE_SECONDS
from sessions.leases.store import LIVE, waits_here
from sessions.models import Session
from telepresence_site.local_credentials import save_local_credentials
from telepresence_site.practice.pool import Demand

PLACE = "office"
PROFILE = "giraff"  # the simulated robot that is driven


def prepare(count: int, mqtt_url: str) -> list[str]:
    """Create or update `count` practice robots with their credentials, disable others, and return
    their names.
    """
    names = [f"practice-{number}" for number in range(1, count + 1)]
    Robot.objects.filter(practice=True).exclude(name__in=names).update(enabled=False)
    if not names:
        return names
    plan = FloorPlan.objects.filter(name=PLACE).first() or store_floor_plan(
        settings.BASE_DIR / "robots" / "world" / "plans" / PLACE
    )
    fields = {
        "title": "Practice",
        "translations": {"es": {"title": "Práctica"}},
        "practice": True,
        "enabled": True,
        "access": Robot.Access.OPEN,
        "floor_plan": plan,
        "returns_home": False,
        "observers_allowed": False,
        "turn_minutes": settings.PRACTICE_MINUTES,
    }
    for name in names:
        robot, made = Robot.objects.get_or_create(name=name, defaults=fields)
        if not made:
            Robot.objects.filter(pk=robot.pk).update(**fields)
        save_local_credentials(robot, mqtt_url)
    return names


def demand(wanted_at: float | None, now: datetime.datetime) -> Demand:
    """Return the demand; `wanted_at` is that of the previous call."""
    recent = now - datetime.timedelta(seconds=PAGE_GONE_SECONDS)
    waiting = Session.objects.filter(waits_here(now), robot__practice=False)
    asked = Robot.objects.filter(practice=True, wanted_at__gte=recent)
    practising = Session.objects.filter(robot__practice=True)
    ended = (
        practising.filter(granted_at__isnull=False, ended_at__isnull=False)
        .order_by()
        .values("robot__name")
        .annotate(at=Max("ended_at"))
    )
    return Demand(
        wanted_at=now.timestamp() if waiting.exists() or asked.exists() else wanted_at,
        taken=frozenset(practising.filter(state__in=LIVE).values_list("robot__name", flat=True)),
        left_at={row["robot__name"]: row["at"].timestamp() for row in ended},
    )
