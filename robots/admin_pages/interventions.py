"""The page with the log of interventions at one robot, and the same as CSV."""

import json
from collections.abc import Iterator
from typing import Any

from django.core.paginator import Paginator
from django.http import HttpRequest, HttpResponse
from django.shortcuts import get_object_or_404
from django.utils import timezone
from django.utils.translation import gettext_lazy as _

from accounts import interventions
from accounts.models import AuditEntry
from robots.admin_pages.overview import RobotPage
from robots.files.csv_text import csv_text
from robots.models import Robot

SHOWN = 50  # on one page
CSV = ("at", "act", "role", "robot", "detail", "data")
ACTS = {
    "stopped": _("stopped"),
    "estop": _("emergency stop"),
    "estop_cleared": _("emergency stop cleared"),
    "released": _("stop released"),
    interventions.SAFETY_TEST: _("safety test"),
    interventions.LIMITS_CHANGED: _("limits or assistance changed"),
    interventions.PROFILE_CHANGED: _("robot's profile changed"),
    interventions.AGENT_CHANGED: _("agent's software changed"),
    interventions.SITE_CHANGED: _("site's software changed"),
    "session_stopped": _("visit ended by an operator"),
    "robot_disabled": _("robot disabled"),
    "robot_enabled": _("robot enabled"),
    "robot_freed": _("robot opened to visitors"),
}
ROLES = {
    "driver": _("driver"),
    "visitor": _("visitor"),
    "observer": _("viewer"),
    "screen": _("person at the robot's screen"),
    "button": _("button on the robot"),
    "owner": _("owner or operator"),
    "staff": _("staff"),
    "server": _("server"),
    "robot": _("robot"),
}


def role_of(user: Any, robot: Robot) -> str:
    """Return the role in which a user who may change a robot does so."""
    return "owner" if robot.owner_id == user.pk else "staff"


class InterventionPage(RobotPage):
    def interventions_view(self, request: HttpRequest, pk: Any) -> HttpResponse:
        robot = get_object_or_404(self.get_queryset(request), pk=pk)
        rows = interventions.of_robot(robot.name)
        page = Paginator(rows, SHOWN).get_page(request.GET.get("page"))
        shown = {"page": page, "entries": [described(row) for row in page]}
        title = _("Interventions at %(robot)s")
        return self.robot_page(request, robot, "interventions", title, **shown)

    def interventions_csv(self, request: HttpRequest, pk: Any) -> HttpResponse:
        """Return the whole log of this robot, the oldest entry first."""
        robot = get_object_or_404(self.get_queryset(request), pk=pk)
        rows = interventions.of_robot(robot.name).order_by("at")
        lines = (
            [value.isoformat() if name == "at" else _text(value) for name, value in one.items()]
            for one in rows.values(*CSV).iterator(chunk_size=500)
        )
        name = f"interventions-{robot.name}-{timezone.now():%Y-%m-%d}.csv"
        return HttpResponse(
            csv_text([CSV, *lines]),
            content_type="text/csv; charset=utf-8",
            headers={"Content-Disposition": f'attachment; filename="{name}"'},
        )


def described(row: AuditEntry) -> dict[str, Any]:
    """Return the texts of an entry for a page."""
    return {
        "at": row.at,
        "what": ACTS.get(row.act, row.act),
        "who": ROLES.get(row.role, row.role) or "–",
        "details": [*_details(row.data)] if row.data else [row.detail],
    }


def _details(data: dict[str, Any]) -> Iterator[str]:
    """Yield a line for each value, or for each change: the values before and after."""
    for name, value in data.items():
        match value:
            case [dict() as before, dict() as after]:
                changed = [key for key in before | after if before.get(key) != after.get(key)]
                yield from (_change(key, before.get(key), after.get(key)) for key in changed)
            case [before, after]:
                yield _change(name, before, after)
            case dict() if value:
                yield ", ".join(f"{key} {_text(one)}" for key, one in value.items() if one != "")
            case "" | dict():
                continue
            case _:
                yield f"{name}: {_text(value)}"


def _change(name: str, before: Any, after: Any) -> str:
    return f"{name}: {_text(before)} → {_text(after)}"


def _text(value: Any) -> str:
    if value is None:
        return "–"
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
