"""The list of robots in the administration: those that need attention come first."""

from typing import Any, get_args

from django.contrib.admin.views.main import ORDER_VAR, ChangeList
from django.db.models import Case, IntegerField, QuerySet, When
from django.http import HttpRequest

from robots.admin_pages.overview import status_of
from robots.admin_pages.owner_status import Tone
from robots.models import Robot

URGENCY: tuple[Tone, ...] = ("bad", "attention", "busy", "good", "off")
assert {*URGENCY} == {*get_args(Tone)}


class RobotList(ChangeList):
    def get_ordering(self, request: HttpRequest, queryset: "QuerySet[Robot]") -> list[Any]:
        ordering = list(super().get_ordering(request, queryset))
        if ORDER_VAR in self.params:
            return ordering
        return [_urgency(queryset), *ordering]


def _urgency(robots: "QuerySet[Robot]") -> Any:
    """Return an expression that sorts robots by how much attention they need. A status is computed
    from a robot's report, so that the database alone cannot sort by it.
    """
    by_tone: dict[Tone, list[Any]] = {tone: [] for tone in URGENCY}
    for robot in robots.order_by():
        by_tone[status_of(robot).tone].append(robot.pk)
    ranks = [When(pk__in=keys, then=URGENCY.index(tone)) for tone, keys in by_tone.items() if keys]
    return Case(*ranks, default=len(URGENCY), output_field=IntegerField()).asc()
