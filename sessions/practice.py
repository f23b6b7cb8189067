"""Simulated robots to practise on, for visitors who wait for a real robot or have no account yet
(telepresence_site/practice runs them).
"""

import datetime
from dataclasses import dataclass
from typing import Any

from django.conf import settings
from django.contrib.auth.decorators import login_required
from django.db.models import Count, Exists, OuterRef
from django.http import Http404, HttpRequest, HttpResponse, JsonResponse
from django.shortcuts import redirect, render
from django.urls import reverse
from django.utils import timezone
from django.utils.translation import ngettext
from django.views.decorators.cache import never_cache
from django.views.decorators.http import require_http_methods, require_POST, require_safe

from accounts.models import User
from accounts.passwordless import NEW_GUESTS, create_guest, open_to_visitors, sign_in
from accounts.rate_limits import limited
from robots.models import Robot
from sessions.leases.store import LIVE
from sessions.models import Session, StateChunk

WANTED_SECONDS = 5  # between two updates of `wanted_at`
# A practice robot restarts after each visitor; older sessions are not considered.
LONGEST_USE = datetime.timedelta(days=1)


@dataclass(frozen=True)
class PracticePlace:
    """A practice robot: whether it can be driven now, and how many drive it or wait for it. After a
    visitor has left it cannot, because it is about to restart.
    """

    name: str
    there: bool
    taken: int


def choose(places: list[PracticePlace]) -> str | None:
    """Return the robot with the shortest queue; None while none can be driven."""
    there = [place for place in places if place.there]
    return min(there, key=lambda place: (place.taken, place.name)).name if there else None


def places(now: datetime.datetime) -> list[PracticePlace]:
    """Return all practice robots in use."""
    living = Session.objects.filter(robot__practice=True, state__in=LIVE).order_by()
    taken = dict(living.values_list("robot").annotate(n=Count("pk")))
    left = StateChunk.objects.filter(
        session__robot=OuterRef("pk"),
        session__state=Session.State.ENDED,
        session__queued_at__gt=now - LONGEST_USE,
        boot=OuterRef("presence__boot"),
    )
    rows = Robot.objects.filter(practice=True, enabled=True).annotate(used=Exists(left))
    return [
        PracticePlace(row.name, row.is_online(now) and not row.used, taken.get(row.pk, 0))
        for row in rows.order_by("name")
    ]


@require_POST
@limited(NEW_GUESTS)
def try_now(request: HttpRequest) -> HttpResponse:
    """Log a visitor without an account in as a guest, and redirect to a practice robot."""
    if not settings.PRACTICE_ROBOTS:
        return _none_offered(request)
    if not request.user.is_authenticated:
        sign_in(request, create_guest(User.Kind.VISITOR))
    return redirect("try_robot")


@open_to_visitors
@never_cache
@require_safe
def try_robot(request: HttpRequest) -> HttpResponse:
    """Show that a practice robot is starting; the page redirects to it when it is ready."""
    if not settings.PRACTICE_ROBOTS:
        return _none_offered(request)
    if not request.user.is_authenticated:
        return redirect("home")
    return render(request, "sessions/try.html", {"trial": trial_length(request.user)})


def trial_length(user: Any) -> str:
    """Return in words how long a visitor without an account may drive; empty for other users."""
    if user.is_authenticated and user.kind != User.Kind.VISITOR:
        return ""
    seconds = round(settings.TRIAL_SECONDS)
    if seconds % 60:
        return ngettext("%(n)d second", "%(n)d seconds", seconds) % {"n": seconds}
    return ngettext("%(n)d minute", "%(n)d minutes", seconds // 60) % {"n": seconds // 60}


def _none_offered(request: HttpRequest) -> HttpResponse:
    return render(request, "sessions/no_trial.html", status=404)


@open_to_visitors
@never_cache
@login_required
@require_http_methods(["GET", "HEAD", "POST"])
def practice(request: HttpRequest) -> JsonResponse:
    """Return the address (`url`) of a drive page to practise on; null while a practice robot
    starts, which takes some seconds, and 404 on a site without practice robots. Waiting visitors
    have sessions, for which robots are started; any other page asks by POST to have one started.
    """
    if not settings.PRACTICE_ROBOTS:
        raise Http404
    now = timezone.now()
    if request.method == "POST":
        _note_wish(request.user, now)
    chosen = choose(places(now))
    return JsonResponse(
        {"url": None if chosen is None else f"{reverse('practice_drive', args=[chosen])}?go=1"}
    )


def _note_wish(user: Any, now: datetime.datetime) -> None:
    # a page asks every other second, and the process that runs the robots looks back further
    known = now - datetime.timedelta(seconds=WANTED_SECONDS)
    Robot.objects.filter(practice=True).exclude(wanted_at__gt=known).update(wanted_at=now)
    if user.kind == User.Kind.VISITOR:
        # a guest logs in once; afterwards this is the time of their last request for a robot, and a
        # day later they are deleted (telepresence_site/ops/retention.py)
        User.objects.filter(pk=user.pk).update(last_login=now)
