"""The drive page, and a visitor's own snapshots."""

import time
from typing import Any
from uuid import UUID

import msgspec
from csp.constants import SELF
from csp.decorators import csp_replace
from django.conf import settings
from django.contrib.auth.decorators import login_required
from django.core.exceptions import PermissionDenied
from django.db.models import Prefetch
from django.http import Http404, HttpRequest, HttpResponse, JsonResponse
from django.shortcuts import get_object_or_404, render
from django.urls import reverse
from django.views.decorators.cache import never_cache
from django.views.decorators.clickjacking import xframe_options_sameorigin
from django.views.decorators.http import require_safe

from accounts.attempts import Attempts
from accounts.models import User
from accounts.passwordless import open_to_visitors
from accounts.rate_limits import limited
from robots.access import has_a_robot, may_drive, may_observe, may_operate, robots_visible_to
from robots.api.messages import IceServer
from robots.api.reasons import ReasonCode
from robots.cards import picture_of
from robots.enrol.elsewhere import redirect_to_home_site
from robots.ice import ice_servers
from robots.models import Robot
from sessions import protocol
from sessions.models import Session, Snapshot

MAX_SNAPSHOTS = 200
MAX_VISITS = 50
LISTS = Attempts("snapshots", limit=240)


@never_cache
@redirect_to_home_site
@login_required
@require_safe
def drive(request: HttpRequest, robot: str) -> HttpResponse:
    """Show a robot's drive page to users who may drive or watch it; 404 for those who may not see
    that the robot exists.
    """
    found = _robot_for(request, robot)
    verdict = may_drive(request.user, found)
    if not verdict and not may_observe(request.user, found):
        raise PermissionDenied(verdict.reason)
    config = page_config(found, request.user)
    if not found.practice:  # for visitors who wait while other robots are free
        config["robots"] = reverse("robots_json")
    context = {"robot": found, "picture": picture_of(found), "config": config}
    return render(request, "sessions/drive.html", context | {"reasons": tuple(ReasonCode)})


@open_to_visitors
@never_cache
@login_required
@require_safe
@xframe_options_sameorigin
@csp_replace({"frame-ancestors": [SELF]})
def practice_drive(request: HttpRequest, robot: str) -> HttpResponse:
    """Show a practice robot's drive page: within a frame for a visitor who waits, or as a page of
    its own for a guest.
    """
    found = _robot_for(request, robot)
    if not found.practice or not may_drive(request.user, found):
        raise Http404
    config = page_config(found, request.user) | {
        "practising": True,
        "practice": None,
        "again": reverse("try_robot"),
    }
    if request.user.kind == User.Kind.VISITOR:
        config["signUp"] = reverse("account_signup")
    shown = {"robot": found, "config": config, "reasons": tuple(ReasonCode)}
    return render(request, "sessions/drive.html", shown)


def page_config(robot: Robot, user: Any) -> dict[str, Any]:
    """Return the configuration of the page's scripts, embedded by `json_script`."""
    plan = robot.floor_plan
    return {
        "robot": robot.name,
        "title": robot.shown_title,
        "who": user.sent_name,
        "check": "/" + protocol.CHECK_PATH,
        "practice": reverse("practice")
        if settings.PRACTICE_ROBOTS and not robot.practice
        else None,
        "socket": "/" + protocol.PATH.replace("<slug:robot>", robot.name),
        "floorplan": reverse("floor_plan", args=[plan.name]) if plan is not None else None,
        "snapshots": reverse("snapshots", args=[robot.name]),
        "factsheet": robot.presence.factsheet,
        "returnsHome": robot.returns_home,
        "assist": Session.assistance_to_begin_with(robot, user) or robot.assist,
        "operates": bool(may_operate(user, robot)),
        "hasScreen": bool(robot.credentials.screen_hash),
    }


@never_cache
@require_safe
def check(request: HttpRequest) -> HttpResponse:
    """Show what browser and network can do. TURN servers are only given to users with a robot."""
    servers = ice_servers(str(request.user.pk), time.time()) if has_a_robot(request.user) else ()
    asked = servers or tuple(
        IceServer(urls=tuple(settings.STUN_URLS)) for _ in settings.STUN_URLS[:1]
    )
    config = {
        "socket": "/" + protocol.CHECK_PATH,
        "iceServers": [msgspec.to_builtins(server) for server in asked],
    }
    return render(request, "sessions/check.html", {"config": config})


def _robot_for(request: HttpRequest, name: str) -> Robot:
    robots = robots_visible_to(request.user).select_related("floor_plan", "credentials")
    robots = robots.defer("floor_plan__image")
    return get_object_or_404(robots, name=name)


@open_to_visitors
@never_cache
@login_required
@require_safe
@limited(LISTS, reading=True, json=True)
def snapshots(request: HttpRequest, robot: str) -> JsonResponse:
    """List the photos that this visitor took with a robot, newest first."""
    rows = (
        _own_snapshots(request.user, robot)
        .order_by("-stamp")
        .values("id", "action_id", "stamp", "session_id")[:MAX_SNAPSHOTS]
    )
    listed = [
        {
            "actionId": row["action_id"],
            "stamp": row["stamp"],
            "session": str(row["session_id"]),
            "url": reverse("snapshot", args=[robot, row["id"]]),
        }
        for row in rows
    ]
    return JsonResponse({"snapshots": listed})


@open_to_visitors
@login_required
@require_safe
def snapshot(request: HttpRequest, robot: str, snapshot: UUID) -> HttpResponse:
    """Answer with one of this visitor's own photos; another visitor's is not found."""
    row = _own_snapshots(request.user, robot).filter(pk=snapshot).first()
    if row is None:
        raise Http404
    headers = {
        "Cache-Control": "private, max-age=86400, immutable",
        "Content-Disposition": f'inline; filename="{robot}-{row.pk}.jpg"',
    }
    return HttpResponse(bytes(row.jpeg), content_type="image/jpeg", headers=headers)


@login_required
@never_cache
@require_safe
def my_visits(request: HttpRequest) -> HttpResponse:
    """List the visitor's last drives, newest first, with the photos that are still stored."""
    photos = Prefetch("snapshots", Snapshot.objects.defer("jpeg").order_by("stamp"))
    rows = (
        Session.objects.filter(
            visitor=request.user.pk, driving_at__isnull=False, robot__practice=False
        )
        .select_related("robot")
        .prefetch_related(photos)
        .order_by("-driving_at")[:MAX_VISITS]
    )
    days = settings.RETENTION_DAYS["photos"]
    return render(request, "sessions/my_visits.html", {"visits": rows, "photo_days": days})


def _own_snapshots(user: Any, robot: str) -> Any:
    return Snapshot.objects.filter(session__visitor=user, session__robot__name=robot)
