"""The demo's one-click link: it signs its visitor in and opens a robot, driving."""

import secrets

from django.conf import settings
from django.contrib.auth import login
from django.http import Http404, HttpRequest, HttpResponse
from django.shortcuts import get_object_or_404, redirect
from django.urls import path
from django.views.decorators.cache import never_cache

from accounts.models import User
from telepresence_site.demo.seed import VISITOR


@never_cache
def enter(request: HttpRequest, token: str, robot: str) -> HttpResponse:
    """Sign the demo's visitor in and go to the robot.

    Signing in on GET is for the demo alone: the address exists only while DEMO_TOKEN is set, which
    `manage.py demo` creates at each start.
    """
    if not settings.DEMO_TOKEN or not secrets.compare_digest(
        token.encode(), settings.DEMO_TOKEN.encode()
    ):
        raise Http404
    visitor = get_object_or_404(User, username=VISITOR)
    login(request, visitor, backend="django.contrib.auth.backends.ModelBackend")
    return redirect(f"/robots/{robot}/?go=1")


urlpatterns = [path("demo/<str:token>/<slug:robot>/", enter, name="demo-enter")]
