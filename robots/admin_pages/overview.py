"""What an owner finds at the top of a robot's page in the administration, before its settings: how
it is, how to start it, and who came. A script keeps it fresh.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Any, Literal

from django.contrib import messages
from django.core.exceptions import PermissionDenied
from django.http import HttpRequest, HttpResponse, JsonResponse
from django.shortcuts import get_object_or_404, render
from django.urls import reverse
from django.utils import timezone
from django.utils.safestring import SafeString

from accounts import audit
from robots.admin_pages.access import WithDriver
from robots.admin_pages.owner_status import OwnerStatus, owner_status
from robots.api.messages import VERSION
from robots.cards import picture_of
from robots.enrol.tokens import open_enrolment
from robots.forms import offered
from robots.models import Robot

Place = Literal["visits", "mail"]
Section = Callable[[HttpRequest, Robot], SafeString | str]
_sections: dict[Place, Section] = {}


def register_section(place: Place, section: Section) -> None:
    """Let an app above this one fill a place of the page; a second registration replaces the
    first.
    """
    _sections[place] = section


class RobotPage(WithDriver):
    """A part of the robots' administration: what its pages share, and a robot's own page."""

    def managed(self, request: HttpRequest, pk: Any) -> Robot:
        """Return a robot for a page that changes it.

        Raises:
            Http404: there is none, or it is not theirs to see.
            PermissionDenied: they may look at it and no more.
        """
        robot: Robot = get_object_or_404(self.get_queryset(request), pk=pk)
        if not self.has_change_permission(request, robot):
            raise PermissionDenied
        return robot

    def robot_page(
        self, request: HttpRequest, robot: Robot, name: str, title: str, **more: Any
    ) -> HttpResponse:
        """Return the page of a template `name` about a robot, whom the title names."""
        context = self.admin_site.each_context(request) | {
            "title": title % {"robot": robot},
            "robot": robot,
            "opts": self.opts,
        }
        return render(request, f"admin/robots/robot/{name}.html", context | more)

    def log(self, request: HttpRequest, robot: Robot, text: str, act: str, **more: str) -> None:
        """Enter a change of a robot into its history, and into the audit log as `act`."""
        self.log_change(request, robot, text)
        audit.note(act, actor=request.user, robot=robot, **more)

    def change_each(
        self,
        request: HttpRequest,
        robots: Sequence[Robot],
        change: Callable[[Robot], object],
        text: str,
        act: str,
        done: str,
    ) -> None:
        """Change several robots and log each change; `done` tells the user their number `n`."""
        for robot in robots:
            change(robot)
            self.log(request, robot, text, act)
        self.message_user(request, done % {"n": len(robots)}, messages.SUCCESS)

    def change_view(
        self,
        request: HttpRequest,
        object_id: str,
        form_url: str = "",
        extra_context: dict[str, Any] | None = None,
        *,
        token: str = "",
    ) -> HttpResponse:
        """Show a robot's page; with a one-time `token`, the command is the one that uses it."""
        found = self.get_object(request, object_id)
        if found is not None and self.has_view_permission(request, found):
            robot = self.get_queryset(request).get(pk=found.pk)
            overview = self._overview(request, robot, token)
            extra_context = {**(extra_context or {}), "overview": overview}
        return super().change_view(request, object_id, form_url, extra_context)

    def status_view(self, request: HttpRequest, pk: Any) -> JsonResponse:
        robot: Robot = get_object_or_404(self.get_queryset(request), pk=pk)
        more = {
            "agent": _agent_version(robot),
            "enrolment": open_enrolment(robot, timezone.now()),
            "enrolled": bool(robot.credentials.credential_hash),
            "fields": self.live_fields(robot),
        }
        return JsonResponse(asdict(status_of(robot)) | more)

    def live_fields(self, robot: Robot) -> dict[str, str]:
        """Return the texts of those fields of the page that change by themselves."""
        raise NotImplementedError

    def _overview(self, request: HttpRequest, robot: Robot, token: str) -> dict[str, Any]:
        return {
            "robot": robot,
            "status": status_of(robot),
            "status_url": reverse("admin:robots_robot_status", args=[robot.pk]),
            "server": request.build_absolute_uri("/").rstrip("/"),
            "token": token,
            "enrolment": open_enrolment(robot, timezone.now()) if token else "",
            "adapters": ", ".join(offered()),
            "may_enrol": self.has_change_permission(request, robot),
            "agent": _agent_version(robot),
            "api": VERSION,
            "picture": picture_of(robot),
            "sections": {place: section(request, robot) for place, section in _sections.items()},
        }


def status_of(robot: Robot) -> OwnerStatus:
    """Return how a robot is now: the one state that every part of its page says."""
    lease = getattr(robot, "lease", None)
    driven = lease is not None and lease.session_id is not None
    return owner_status(robot, driven=driven, now=timezone.now())


def _agent_version(robot: Robot) -> str:
    """Return the version that the agent reported, empty when it reported none."""
    sheet = robot.presence.factsheet if isinstance(robot.presence.factsheet, dict) else {}
    return str(sheet.get("agentVersion", ""))
