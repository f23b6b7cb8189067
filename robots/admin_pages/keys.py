"""Keys in the administration, each shown once: the one-time token of a robot's computer, and the
address of its screen; and the rotation of credentials.
"""

from typing import Any

from django.contrib import admin, messages
from django.db.models import QuerySet
from django.http import HttpRequest, HttpResponse, HttpResponseRedirect
from django.shortcuts import render
from django.urls import reverse
from django.utils import timezone
from django.utils.translation import gettext as _
from django.utils.translation import gettext_lazy, ngettext

from accounts import audit
from robots.admin_pages.access import OfRobots, theirs_to_change
from robots.admin_pages.overview import OverviewPage
from robots.enrol.credentials import ask_for_renewal
from robots.enrol.tokens import make_token
from robots.models import Robot
from robots.screens import make_screen_key, revoke_screen_key, screen_address


class EnrolmentPage(OverviewPage):
    """A part of the robots' administration."""

    def enrol_view(self, request: HttpRequest, pk: Any) -> HttpResponse:
        """Ask whether to make a one-time token, and show it once, on the robot's page."""
        robot: Robot = self.managed(request, pk)
        if request.method == "POST":
            token = make_token(robot, timezone.now())
            self.log_change(request, robot, _("New one-time token."))
            audit.note("enrolment_made", actor=request.user, robot=robot)
            page = reverse("admin:robots_robot_change", args=[robot.pk])
            request.method = "GET"  # for the page, whose own form was not sent
            try:
                return self.change_view(request, str(robot.pk), form_url=page, token=token)
            finally:
                request.method = "POST"
        context: dict[str, Any] = self.admin_site.each_context(request) | {
            "title": _("Enrolment of %(robot)s") % {"robot": robot},
            "robot": robot,
            "opts": self.opts,
        }
        return render(request, "admin/robots/robot/enrol.html", context)

    @admin.action(description=gettext_lazy("Request credential renewal"), permissions=["change"])
    def rotate_credentials(self, request: HttpRequest, robots: "QuerySet[Robot]") -> None:
        """Let the agents take new credentials by themselves; the present ones
        hold for a day more.
        """
        chosen = list(theirs_to_change(request, robots).exclude(credentials__credential_hash=""))
        for robot in chosen:
            ask_for_renewal(robot, timezone.now())
            self.log_change(request, robot, _("Credential renewal requested."))
            audit.note("rotation_asked", actor=request.user, robot=robot)
        text = ngettext(
            "%(n)d robot renews its credentials by itself.",
            "%(n)d robots renew their credentials by themselves.",
            len(chosen),
        )
        self.message_user(request, text % {"n": len(chosen)}, messages.SUCCESS)


class ScreenPage(OfRobots):
    """A part of the robots' administration."""

    def screen_view(self, request: HttpRequest, pk: Any) -> HttpResponse:
        """Ask whether to make a new key, and show the address once; a POST with `revoke` takes the
        present one away.
        """
        robot: Robot = self.managed(request, pk)
        context = self.admin_site.each_context(request) | {
            "title": _("Screen of %(robot)s") % {"robot": robot},
            "robot": robot,
            "opts": self.opts,
        }
        if request.method == "POST" and "revoke" in request.POST:
            revoke_screen_key(robot)
            self.log_change(request, robot, _("Screen key revoked."))
            audit.note("screen_key_revoked", actor=request.user, robot=robot)
            messages.success(request, _("The screen's address no longer works."))
            return HttpResponseRedirect(request.path)
        if request.method == "POST":
            key = make_screen_key(robot, timezone.now())
            self.log_change(request, robot, _("New screen key."))
            audit.note("screen_key_made", actor=request.user, robot=robot)
            context["address"] = screen_address(
                robot, key, request.build_absolute_uri("/").rstrip("/")
            )
        return render(request, "admin/robots/robot/screen.html", context)
