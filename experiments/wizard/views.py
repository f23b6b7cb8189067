"""The page of a hidden operator."""

from typing import Any

from django.http import Http404, HttpRequest, HttpResponse
from django.shortcuts import render
from django.views.decorators.cache import never_cache
from django.views.decorators.http import require_safe

from experiments.access import may, may_operate_as_wizard
from experiments.models import Study
from experiments.wizard.operators import operated_robots
from robots.models import Robot
from sessions.wizard import protocol


@never_cache
@require_safe
def console(request: HttpRequest, slug: str) -> HttpResponse:
    versions = list(Study.objects.filter(slug=slug).order_by("-version"))
    if not versions or not may_operate_as_wizard(request.user, slug):
        raise Http404
    # the newest version with a hidden operator, or else the newest
    operated = (one for one in versions if one.as_definition().wizard is not None)
    study = next(operated, versions[0])
    definition = study.as_definition()
    robots = operated_robots(definition) if definition.wizard is not None else []
    robot = next((one for one in robots if one.name == request.GET.get("robot")), None)
    robot = robot or (robots[0] if robots else None)
    context = {
        "study": study,
        "has_operator": definition.wizard is not None,
        "may_build": study.status == Study.Status.DRAFT and may(request.user, slug, "owner"),
        "robots": robots,
        "robot": robot,
        "config": _config(robot) if robot is not None else None,
    }
    return render(request, "experiments/wizard/console.html", context)


def _config(robot: Robot) -> dict[str, Any]:
    """Return what the page's script needs; it reveals no condition."""
    factsheet = robot.presence.factsheet or {}
    return {
        "robot": robot.name,
        "socket": "/" + protocol.PATH.replace("<slug:robot>", robot.name),
        "limits": factsheet.get("limits"),
    }
