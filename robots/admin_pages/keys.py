"""Pages that show a secret once: a robot's credentials, the one-time token of its computer, and the
address of its screen.
"""

from typing import Any
from urllib.parse import quote

from django.contrib import admin, messages
from django.db.models import QuerySet
from django.http import HttpRequest, HttpResponse, HttpResponseRedirect
from django.urls import reverse
from django.utils import timezone
from django.utils.translation import gettext as _, gettext_lazy, ngettext

from robots.admin_pages.access import theirs_to_change
from robots.admin_pages.overview import RobotPage
from robots.enrol.connect_command import connect_command, credentials_file, unreachable
from robots.enrol.credentials import ask_for_renewal, make_credentials, revoke
from robots.enrol.tokens import make_token
from robots.forms import KindForm
from robots.models import Robot
from robots.screens import make_screen_key, revoke_screen_key, screen_address


def _server(request: HttpRequest) -> str:
    return request.build_absolute_uri("/").rstrip("/")


class KeyPages(RobotPage):
    def enrol_view(self, request: HttpRequest, pk: Any) -> HttpResponse:
        """Ask what kind of robot it is, and show the command with a one-time token once, on the
        robot's page.
        """
        robot = self.managed(request, pk)
        form = KindForm(request.POST or None, instance=robot)
        if request.method != "POST" or not form.is_valid():
            title = _("Connect %(robot)s")
            shown = {"form": form, "unreachable": unreachable(_server(request))}
            return self.robot_page(request, robot, "enrol", title, **shown)
        form.save()
        token = make_token(robot, timezone.now())
        self.log(request, robot, _("New one-time token."), "enrolment_made")
        page = reverse("admin:robots_robot_change", args=[robot.pk])
        request.method = "GET"  # the form of the robot's page was not sent
        try:
            return self.change_view(request, str(robot.pk), form_url=page, token=token)
        finally:
            request.method = "POST"

    def screen_view(self, request: HttpRequest, pk: Any) -> HttpResponse:
        """Ask whether to create a new key, and show the address once; a POST with `revoke` revokes
        the present one.
        """
        robot, shown = self.managed(request, pk), {}
        if request.method == "POST" and "revoke" in request.POST:
            revoke_screen_key(robot)
            self.log(request, robot, _("Screen key revoked."), "screen_key_revoked")
            messages.success(request, _("The screen's address no longer works."))
            return HttpResponseRedirect(request.path)
        if request.method == "POST":
            key = make_screen_key(robot, timezone.now())
            self.log(request, robot, _("New screen key."), "screen_key_made")
            shown = {"address": screen_address(robot, key, _server(request))}
        return self.robot_page(request, robot, "screen", _("Screen of %(robot)s"), **shown)

    def credentials_view(self, request: HttpRequest, pk: Any) -> HttpResponse:
        """Ask whether to create new credentials, and show them once."""
        robot, shown = self.managed(request, pk), {}
        if request.method == "POST":
            made, server = make_credentials(robot, timezone.now()), _server(request)
            self.log(request, robot, _("New credentials created."), "credentials_made")
            toml, file = credentials_file(robot, made, server), f"{robot.name}.toml"
            shown = {
                "token": made.token,
                "toml": toml,
                "command": connect_command(robot, server, file=file),
                "unreachable": unreachable(server),
                "file": file,
                # in the page itself, so that the token need not be stored for a second request
                "download": f"data:application/toml,{quote(toml)}",
            }
        title = _("Credentials of %(robot)s")
        return self.robot_page(request, robot, "credentials", title, **shown)

    @admin.action(description=gettext_lazy("Create new credentials"), permissions=["change"])
    def new_credentials(
        self, request: HttpRequest, robots: "QuerySet[Robot]"
    ) -> HttpResponse | None:
        """Go to the page that creates them, for one robot at a time."""
        chosen = list(theirs_to_change(request, robots)[:2])
        if len(chosen) == 1:
            page = reverse("admin:robots_robot_credentials", args=[chosen[0].pk])
            return HttpResponseRedirect(page)
        text = _("Choose a single robot: its credentials are shown only once.")
        self.message_user(request, text, messages.ERROR)
        return None

    @admin.action(description=gettext_lazy("Request credential renewal"), permissions=["change"])
    def rotate_credentials(self, request: HttpRequest, robots: "QuerySet[Robot]") -> None:
        """Let the agents fetch new credentials; the present ones remain valid for a day."""
        chosen = list(theirs_to_change(request, robots).exclude(credentials__credential_hash=""))
        text = ngettext(
            "%(n)d robot renews its credentials by itself.",
            "%(n)d robots renew their credentials by themselves.",
            len(chosen),
        )
        logged = _("Credential renewal requested.")
        now = timezone.now()
        self.change_each(
            request, chosen, lambda r: ask_for_renewal(r, now), logged, "rotation_asked", text
        )

    @admin.action(description=gettext_lazy("Revoke the credentials"), permissions=["change"])
    def revoke_credentials(self, request: HttpRequest, robots: "QuerySet[Robot]") -> None:
        """Revoke the tokens; the broker disconnects the robots within seconds."""
        chosen = list(theirs_to_change(request, robots))
        text = ngettext(
            "%(n)d robot can no longer connect.", "%(n)d robots can no longer connect.", len(chosen)
        )
        self.change_each(
            request, chosen, revoke, _("Credentials revoked."), "credentials_revoked", text
        )
