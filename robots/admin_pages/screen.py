"""The key of a robot's screen in the administration: made, shown once, taken away."""

from typing import Any

from django.contrib import messages
from django.http import HttpRequest, HttpResponse, HttpResponseRedirect
from django.shortcuts import render
from django.utils import timezone
from django.utils.translation import gettext as _

from accounts import audit
from robots.admin_pages.access import OfRobots
from robots.models import Robot
from robots.screens import make_screen_key, revoke_screen_key, screen_address


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
            self.log_change(request, robot, _("Screen key taken away."))
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
