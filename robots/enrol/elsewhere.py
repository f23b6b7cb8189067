"""Robots that another site of the same organization serves: their pages redirect there, and an
agent that connects to the wrong site gets the right address.

An agent is not redirected, because it must not send credentials to an address that a server names.
A robot that is enabled here is served here, whatever the directory says.
"""

from collections.abc import Callable
from functools import wraps

from django.http import HttpRequest, HttpResponse, HttpResponseRedirect, JsonResponse

from robots.models import Robot, RobotElsewhere

MISDIRECTED = 421  # RFC 9110, 15.5.20
LOOP_GUARD = "from_site"  # an address with it is not redirected again


def site_of(name: str) -> str | None:
    """Return the address of the other site that serves a robot, or None."""
    site = RobotElsewhere.objects.filter(name=name).values_list("site", flat=True).first()
    if site is None or Robot.objects.filter(name=name, enabled=True).exists():
        return None
    return str(site)


def redirect_to_home_site(view: Callable[..., HttpResponse]) -> Callable[..., HttpResponse]:
    """Redirect a robot's page to the site that serves the robot, before it requires a login."""

    @wraps(view)
    def redirecting(request: HttpRequest, robot: str) -> HttpResponse:
        site = None if LOOP_GUARD in request.GET else site_of(robot)
        if site is None:
            return view(request, robot)
        query = request.GET.copy()
        query[LOOP_GUARD] = request.get_host()
        return HttpResponseRedirect(f"{site}{request.path}?{query.urlencode()}")

    return redirecting


def misdirected(name: str) -> JsonResponse | None:
    """Return the answer to an agent whose robot another site serves, or None."""
    site = site_of(name)
    if site is None:
        return None
    detail = (
        f"{name} is served by {site}. Start the agent with --server {site} and a one-time token"
        " that was made there."
    )
    return JsonResponse({"error": "other_site", "detail": detail, "site": site}, status=MISDIRECTED)
