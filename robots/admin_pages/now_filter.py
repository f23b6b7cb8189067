"""Robots by how they are at this moment, which no field of their rows says: for their list, and for
the numbers of the administration's first page that lead there.
"""

from typing import Any

from django.contrib import admin
from django.http import HttpRequest
from django.utils import timezone
from django.utils.translation import gettext_lazy as _

from robots.presence.report import has_problem


class NowFilter(admin.SimpleListFilter):
    """Robots that are online, are in use, or have a problem now."""

    title = _("now")
    parameter_name = "now"

    def lookups(self, _request: HttpRequest, _model_admin: Any) -> list[tuple[str, Any]]:
        return [("online", _("online")), ("in_use", _("in use")), ("problem", _("with a problem"))]

    def queryset(self, _request: HttpRequest, queryset: Any) -> Any:
        now, chosen = timezone.now(), self.value()
        if chosen == "in_use":
            return queryset.filter(lease__session__isnull=False)
        if chosen not in {"online", "problem"}:
            return queryset
        rows = queryset.select_related(None).select_related("presence")
        return queryset.filter(
            pk__in=[
                robot.pk
                for robot in rows
                if (robot.is_online(now) if chosen == "online" else has_problem(robot, now))
            ]
        )
