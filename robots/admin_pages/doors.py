"""The doors of a simulated site, opened and closed from the administration at any time."""

from typing import Any

from django.contrib import messages
from django.db import transaction
from django.http import HttpRequest, HttpResponse, HttpResponseRedirect
from django.utils.translation import get_language
from django.utils.translation import gettext as _

from robots.admin_pages.overview import RobotPage
from robots.models import Robot

STATES = ("open", "closed")


def has_doors(robot: Robot) -> bool:
    """Tell whether there is a door that the server can move: the robot says so, and its site has
    one.
    """
    return "doors" in (robot.presence.factsheet or {}).get("capabilities", ()) and bool(
        robot.doors_in("")
    )


class DoorPage(RobotPage):
    """A part of the robots' administration."""

    def doors_view(self, request: HttpRequest, pk: Any) -> HttpResponse:
        """Show the doors; a POST with `door` and `state` moves one."""
        robot = self.managed(request, pk)
        if request.method == "POST":
            self._move(request, robot, request.POST.get("door", ""), request.POST.get("state", ""))
            return HttpResponseRedirect(request.path)
        return self.robot_page(
            request,
            robot,
            "doors",
            _("Doors of %(robot)s"),
            doors=robot.doors_in(get_language() or ""),
            movable=has_doors(robot),
        )

    def _move(self, request: HttpRequest, robot: Robot, name: str, state: str) -> None:
        titles = {door["name"]: door["title"] for door in robot.doors_in(get_language() or "")}
        if name not in titles or state not in STATES:
            messages.error(request, _("This door doesn't exist."))
            return
        with transaction.atomic():  # another door may have been moved since the robot was read
            rows = Robot.objects.select_related(None).select_for_update()
            doors = rows.get(pk=robot.pk).doors | {name: state}
            Robot.objects.filter(pk=robot.pk).update(doors=doors)
        text = (
            _("%(door)s is set to open.") if state == "open" else _("%(door)s is set to closed.")
        ) % {"door": titles[name]}
        self.log(request, robot, text, "door_moved", thing=name, detail=state)
        messages.success(request, text)
