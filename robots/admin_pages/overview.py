"""The top of a robot's page in the administration: its status, how to start it, and its last
visits. A script updates it.
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
from robots.enrol.connect_command import connect_command, unreachable
from robots.enrol.tokens import open_enrolment
from robots.forms import KindForm
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
    """The main page of a robot, and the base class of its other pages."""

    def managed(self, request: HttpRequest, pk: Any) -> Robot:
        """Return a robot for a page that changes it.

        Raises:
            Http404: it does not exist, or the user may not view it.
            PermissionDenied: the user may only view it.
        """
        robot: Robot = get_object_or_404(self.get_queryset(request), pk=pk)
        if not self.has_change_permission(request, robot):
            raise PermissionDenied
        return robot

    def robot_page(
        self, request: HttpRequest, robot: Robot, name: str, title: str, **more: Any
    ) -> HttpResponse:
        """Render the template `name`; `%(robot)s` in the title is the robot."""
        context = self.admin_site.each_context(request) | {
            "title": title % {"robot": robot},
            "robot": robot,
            "opts": self.opts,
        }
        return render(request, f"admin/robots/robot/{name}.html", context | more)

    def log(self, request: HttpRequest, robot: Robot, text: str, act: str, **more: Any) -> None:
        """Add a change to a robot's history, and to the audit log as `act`."""
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
        """Change several robots and log each change; `done` is shown, with their number `n`."""
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
        """Show a robot's page; its command contains the one-time `token`, if there is one."""
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
        """Return the texts of fields that the page updates."""
        raise NotImplementedError

    def _overview(self, request: HttpRequest, robot: Robot, token: str) -> dict[str, Any]:
        server = request.build_absolute_uri("/").rstrip("/")
        has_key = bool(token or robot.credentials.credential_hash)
        return {
            "robot": robot,
            "status": status_of(robot),
            "status_url": reverse("admin:robots_robot_status", args=[robot.pk]),
            "command": connect_command(robot, server) if has_key else "",
            "unreachable": unreachable(server),
            "kind": KindForm(instance=robot),
            "token": token,
            "enrolment": open_enrolment(robot, timezone.now()) if token else "",
            "may_enrol": self.has_change_permission(request, robot),
            "agent": _agent_version(robot),
            "api": VERSION,
            "picture": picture_of(robot),
            "sections": {place: section(request, robot) for place, section in _sections.items()},
        }


def status_of(robot: Robot) -> OwnerStatus:
    """Return the robot's status now, the same for all parts of its page."""
    lease = getattr(robot, "lease", None)
    in_use = lease is not None and lease.session_id is not None
    return owner_status(robot, in_use=in_use, now=timezone.now())


def _agent_version(robot: Robot) -> str:
    sheet = robot.presence.factsheet if isinstance(robot.presence.factsheet, dict) else {}
    return str(sheet.get("agentVersion", ""))
