"""The doors of a simulated site, which the administration opens and closes."""

from typing import Any

from django.contrib import messages
from django.db import transaction
from django.http import HttpRequest, HttpResponse, HttpResponseRedirect
from django.utils.translation import get_language, gettext as _

from robots.admin_pages.overview import RobotPage
from robots.models import Robot

STATES = ("open", "closed")


def has_doors(robot: Robot) -> bool:
    """Tell whether the server can move a door: the robot can, and its site has one."""
    capabilities = (robot.presence.factsheet or {}).get("capabilities", ())
    return "doors" in capabilities and bool(robot.doors_in(""))


class DoorPage(RobotPage):
    def doors_view(self, request: HttpRequest, pk: Any) -> HttpResponse:
        """Show the doors; a POST with `door` and `state` moves one."""
        robot = self.managed(request, pk)
        if request.method == "POST":
            self._move(request, robot, request.POST.get("door", ""), request.POST.get("state", ""))
            return HttpResponseRedirect(request.path)
        shown = {"doors": robot.doors_in(get_language() or ""), "movable": has_doors(robot)}
        return self.robot_page(request, robot, "doors", _("Doors of %(robot)s"), **shown)

    def _move(self, request: HttpRequest, robot: Robot, name: str, state: str) -> None:
        titles = {door["name"]: door["title"] for door in robot.doors_in(get_language() or "")}
        if name not in titles or state not in STATES:
            messages.error(request, _("This door doesn't exist."))
            return
        with transaction.atomic():  # another user may move another door at the same time
            rows = Robot.objects.select_related(None).select_for_update()
            doors = rows.get(pk=robot.pk).doors | {name: state}
            Robot.objects.filter(pk=robot.pk).update(doors=doors)
        done = _("%(door)s is set to open.") if state == "open" else _("%(door)s is set to closed.")
        text = done % {"door": titles[name]}
        self.log(request, robot, text, "door_moved", thing=name, detail=state)
        messages.success(request, text)
