"""Robots that another site of the same house serves: pages lead there, and an agent that comes to
the wrong site is told the right one.

An agent is told and never sent, so that no credentials go to an address that a server named. A
robot that is enabled here is served here, whatever the directory says.
"""

from collections.abc import Callable
from functools import wraps

from django.http import HttpRequest, HttpResponse, HttpResponseRedirect, JsonResponse

from robots.models import Robot, RobotElsewhere

MISDIRECTED = 421  # RFC 9110, 15.5.20
MARK = "from_site"  # an address with it leads no further, where two sites name each other


def site_of(name: str) -> str | None:
    """Return the address of the other site that serves a robot; None when none is known, or this
    one serves it.
    """
    site = RobotElsewhere.objects.filter(name=name).values_list("site", flat=True).first()
    if site is None or Robot.objects.filter(name=name, enabled=True).exists():
        return None
    return str(site)


def led_to_its_site(view: Callable[..., HttpResponse]) -> Callable[..., HttpResponse]:
    """Lead from a robot's page to the same page at the site that serves it, before anybody is asked
    to log in here.
    """

    @wraps(view)
    def leading(request: HttpRequest, robot: str) -> HttpResponse:
        site = None if MARK in request.GET else site_of(robot)
        if site is None:
            return view(request, robot)
        asked = request.GET.copy()
        asked[MARK] = request.get_host()
        return HttpResponseRedirect(f"{site}{request.path}?{asked.urlencode()}")

    return leading


def misdirected(name: str) -> JsonResponse | None:
    """Return what an agent is told whose robot another site serves; None when none is known."""
    site = site_of(name)
    if site is None:
        return None
    detail = (
        f"{name} is served by {site}. Start the agent with --server {site} and a one-time token"
        " that was made there."
    )
    return JsonResponse({"error": "other_site", "detail": detail, "site": site}, status=MISDIRECTED)
