"""The page on which an owner tests the safety functions of a robot, and its results."""

from typing import Any

from django.contrib import messages
from django.http import HttpRequest, HttpResponse, HttpResponseRedirect
from django.utils import timezone
from django.utils.formats import number_format
from django.utils.translation import gettext, gettext_lazy as _

from accounts.models import AuditEntry
from robots.admin_pages.overview import RobotPage
from robots.models import Robot
from robots.readiness_text import in_words
from sessions.safety_test import course

REFRESH_SECONDS = 3
RESULTS_SHOWN = 10
MOST_CM = 50
AGAINST = {
    "offline": _("The robot is not connected."),
    "unsupported": _("The robot's agent is too old for this test. Upgrade it."),
    "driven": _("A visitor has the robot. Test it when the visit has ended."),
    "queue": _("Visitors wait for the robot. Pause the queue, or test it later."),
    "estop": _("The robot's emergency stop is on. Clear it first."),
    "not_connected": _("The agent doesn't reach the robot."),
    "fault": _("The robot reports a fault."),
    "stopped": _(
        "Someone stopped the robot. Release the stop first, at the robot or by driving it."
    ),
    "docked": _("The robot is on its charging station. Drive it to a free place first."),
    "navigating": _("The robot drives by itself. Test it when it has arrived."),
}
OUTCOMES = {
    "passed": _("passed"),
    "failed": _("failed"),
    "not_run": _("not run"),
    "broken_off": _("ended early"),
}
STOPS = {
    "silence": _("no commands"),
    "stop": _("stop"),
    "estop": _("emergency stop"),
}
# Reasons of the session of a test that ended without a result.
ENDINGS = {
    "robot_offline": _("The connection to the robot was lost. The robot stops by itself."),
    "visitor_silent": _("The connection to the robot was lost. The robot stops by itself."),
    "page_gone": _("The robot's agent did not start the test."),
    "turn_over": _("The test took too long. The robot has stopped."),
    "by an operator": _("A person ended the test. The robot has stopped."),
    "maintenance": _("The site's maintenance ended the test. The robot has stopped."),
    "robot_disabled": _("The robot was disabled during the test. It has stopped."),
}


def safety_test_page(page: RobotPage, request: HttpRequest, robot: Robot) -> HttpResponse:
    """Show the test, and start or end it with a POST; `page` is that of the robot."""
    now, session = timezone.now(), course.running(robot)
    if request.method == "POST":
        if request.POST.get("action") == "end" and session is not None:
            course.stop(session, now)
        elif request.POST.get("action") == "start":
            _start(request, robot)
        return HttpResponseRedirect(request.path)
    reason = "" if session is not None else course.reason_against(robot, now)
    shown = {
        "running": session is not None,
        "is_lost": session is not None and not robot.is_online(now),
        "against": AGAINST.get(reason, reason),
        "is_docked": (robot.presence.report or {}).get("docked"),
        "centimetres": MOST_CM,
        "results": [described(row) for row in course.results_of(robot.name)[:RESULTS_SHOWN]],
    }
    title = _("Safety test of %(robot)s")
    answer = page.robot_page(request, robot, "safety_test", title, **shown)
    if session is not None:
        answer["Refresh"] = str(REFRESH_SECONDS)
    return answer


def _start(request: HttpRequest, robot: Robot) -> None:
    if not request.POST.get("free"):
        messages.error(request, gettext("Confirm that the floor around the robot is free."))
    elif reason := course.start(robot, request.user, timezone.now()):
        messages.error(request, AGAINST.get(reason, reason))


def described(row: AuditEntry) -> dict[str, Any]:
    """Return the texts and figures of a test for a page."""
    data, figures = row.data, row.data.get("figures", {})
    reason = data.get("reason", "")
    return {
        "at": row.at,
        "outcome": data.get("outcome", ""),
        "title": OUTCOMES.get(data.get("outcome", ""), ""),
        "reason": ENDINGS.get(reason) or _in_words(reason),
        "stops": [
            {
                "title": title,
                "seconds": _with_unit(figures[f"{name}_s"], "s"),
                "metres": _with_unit(figures[f"{name}_m"], "m"),
                "within": _with_unit(figures[f"{name}_within_s"], "s"),
                "holds": figures.get(f"{name}_holds"),
            }
            for name, title in STOPS.items()
            if f"{name}_s" in figures
        ],
        "fastest": figures.get("fastest"),
        "limit": figures.get("limit"),
        "versions": ", ".join(
            f"{name} {version}" for name, version in data.get("versions", {}).items() if version
        ),
    }


def _in_words(reason: str) -> str:
    """Return the reason of the agent, whose value may be one of STOPS."""
    code, colon, value = reason.partition(": ")
    return in_words(f"{code}{colon}{STOPS.get(value, value)}")


def _with_unit(figure: float, unit: str) -> str:
    return f"{number_format(round(figure, 2), 2)}\u00a0{unit}"
