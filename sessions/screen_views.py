"""The page of a robot's own display, and how it gets its key."""

import time

from django.http import HttpRequest, HttpResponse, JsonResponse
from django.middleware.csrf import get_token
from django.shortcuts import render
from django.urls import reverse
from django.views.decorators.cache import never_cache
from django.views.decorators.http import require_POST, require_safe

from accounts.attempts import Attempts, address_of
from accounts.rate_limits import too_many
from robots.screens import YEAR, cookie_of, screen_of
from sessions import protocol

REFUSED = Attempts("screen-refused", limit=20)


@never_cache
@require_safe
def screen(request: HttpRequest, robot: str) -> HttpResponse:
    """Show the page of a robot's screen; without the key it is empty and says that the key is
    missing.

    The address is public. Without the key the page is therefore the same for every name, so that it
    reveals neither the existence nor the title of a robot that is not public.
    """
    found = screen_of(robot, request.COOKIES.get(cookie_of(robot), ""))
    config = {
        "robot": robot,
        "title": found.shown_title if found is not None else robot,
        "socket": "/" + protocol.SCREEN_PATH.replace("<slug:robot>", robot),
        "key": reverse("screen_key", args=[robot]),
        "csrf": get_token(request),
    }
    return render(
        request,
        "sessions/screen.html",
        {"title": found.shown_title if found is not None else robot, "config": config},
    )


@never_cache
@require_POST
def screen_key(request: HttpRequest, robot: str) -> HttpResponse:
    """Take the key from after the `#`, and return it as a cookie that no script can read."""
    address, now = address_of(request), time.time()
    if not REFUSED.are_left(address, now):
        return too_many(request, REFUSED.wait(address, now), json=True)
    key = request.POST.get("key", "")[:200]
    if screen_of(robot, key) is None:
        REFUSED.count(address, now)
        return JsonResponse({"error": "wrong_key"}, status=403)
    response = HttpResponse(status=204)
    response.set_cookie(
        cookie_of(robot),
        key,
        max_age=YEAR,
        httponly=True,
        samesite="Strict",
        secure=request.is_secure(),
    )
    return response
